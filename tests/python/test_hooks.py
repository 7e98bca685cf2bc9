# SPDX-License-Identifier: BSD-3-Clause
"""Means inside of torch and jax have the derivatives of `gradient`. Parts whose package is missing are skipped."""

import numpy as np
import pytest
import symsde as ss
from symsde.errors import IncompatibleError, InvalidArgumentError, MissingPackageError, WrongShapeError, WrongTypeError

RUN = {"q0": 0.7, "p0": 0.3, "step": 0.1, "steps": 12, "paths": 20, "seed": 3, "scheme": "stormer_verlet"}
NAMES = ["k", "sigma", "q0", "p0"]


def model(**values):
    """A pendulum with a noise."""
    return ss.model_from_sympy("p**2/2 - k*cos(q)", ["sigma*sin(q)"], params={"k": 1.3, "sigma": 0.4} | values)


def cost(t, q, p):
    """A function of the whole path, of arrays of any package: powers, products and a mean."""
    return (q[1:, 0] ** 2 * t[1:, None] + q[1:, 0] * p[1:, 0]).mean(0)


def slope(t, q, p):
    """Its derivative."""
    fq, fp = np.zeros_like(q), np.zeros_like(p)
    fq[1:, 0] = (2 * q[1:, 0] * t[1:, None] + p[1:, 0]) / (len(t) - 1)
    fp[1:, 0] = q[1:, 0] / (len(t) - 1)
    return fq, fp


def test_derivatives_by_torch():
    """The same f by hand and by torch; a function that does not depend on p, or on the state at all, has zeros."""
    torch = pytest.importorskip("torch")
    right = ss.gradient(model(), (cost, slope), NAMES, **RUN, save_every=3)
    found = ss.gradient(model(), ss.torch_derivative(cost), NAMES, **RUN, save_every=3)
    for name in NAMES:
        np.testing.assert_allclose(found.by_path[name], right.by_path[name], rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(found.f, right.f, rtol=1e-14)
    ends = ss.gradient(model(), ss.torch_derivative(lambda t, q, p: torch.sin(q[-1, 0])), NAMES, **RUN)
    np.testing.assert_allclose(ends.values["k"], ss.gradient(model(), "sin(q)", "k", **RUN).values["k"], rtol=1e-12)
    nothing = ss.gradient(model(), ss.torch_derivative(lambda t, q, p: 0 * t[:1].expand(q.shape[-1])), "k", **RUN)
    assert nothing.values["k"] == 0
    with pytest.raises(WrongTypeError, match="return a tensor of torch"):
        ss.gradient(model(), ss.torch_derivative(lambda t, q, p: 3.0), **RUN)


def test_derivatives_by_jax():
    """The same f by hand and by jax, in double precision whatever jax is set to."""
    pytest.importorskip("jax")
    right = ss.gradient(model(), (cost, slope), NAMES, **RUN, save_every=3)
    found = ss.gradient(model(), ss.jax_derivative(cost), NAMES, **RUN, save_every=3)
    for name in NAMES:
        np.testing.assert_allclose(found.by_path[name], right.by_path[name], rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(found.f, right.f, rtol=1e-13)
    with pytest.raises(IncompatibleError, match="called from inside of jax"):
        ss.jax_function(model(), ss.jax_derivative(cost), **RUN)


def test_torch():
    """backward() of an expression of E f gives the chain rule over the derivatives of gradient."""
    torch = pytest.importorskip("torch")
    mean = ss.torch_function(model(), "q*p + k", NAMES, **RUN)
    right = ss.gradient(model(), "q*p + k", NAMES, **RUN)
    start = [1.3, 0.4, 0.7, [0.3]]
    given = [torch.tensor(x, dtype=torch.float64, requires_grad=True) for x in start]
    value = mean(*given)
    assert value.item() == right.value
    (value**2).backward()
    for x, name in zip(given, NAMES, strict=True):
        assert x.grad.shape == x.shape
        np.testing.assert_allclose(x.grad.numpy().ravel(), 2 * right.value * np.ravel(right.values[name]), rtol=1e-13)
    single = torch.tensor(0.4, requires_grad=True)
    out = mean(given[0], p0=0.3, q0=0.7, sigma=single)
    out.backward()
    assert single.grad.dtype == torch.float32 and abs(single.grad.item() / right.values["sigma"] - 1) < 1e-5
    assert torch.autograd.gradcheck(mean, given, eps=1e-5, atol=1e-6)


def test_torch_by_path():
    """f of each path; values that differ by path."""
    torch = pytest.importorskip("torch")
    each = ss.torch_function(model(), (cost, slope), ["sigma", "q0"], **RUN, by_path=True)
    sigma, q0 = np.linspace(0.2, 0.5, 20), np.linspace(0.1, 0.9, 20)[np.newaxis]
    given = [torch.tensor(x, requires_grad=True) for x in (sigma, q0)]
    values, weights = each(*given), torch.linspace(-1, 2, 20, dtype=torch.float64)
    (values * weights).sum().backward()
    right = ss.gradient(model(sigma=sigma), (cost, slope), ["sigma", "q0"], **RUN | {"q0": q0})
    np.testing.assert_array_equal(values.detach().numpy(), right.f)
    for x, name in zip(given, ("sigma", "q0"), strict=True):
        np.testing.assert_allclose(x.grad.numpy(), weights.numpy() * right.by_path[name], rtol=1e-13)
    one = ss.torch_function(model(), "q", "q0", **RUN)
    column = torch.tensor([[0.7]], dtype=torch.float64, requires_grad=True)
    one(column).backward()
    np.testing.assert_allclose(column.grad.item(), ss.gradient(model(), "q", "q0", **RUN).values["q0"][0], rtol=1e-13)


def test_jax():
    """grad, jit and vmap of E f; values by path, in single and in double precision."""
    jax = pytest.importorskip("jax")
    right = ss.gradient(model(), "q*p + k", NAMES, **RUN)
    mean = ss.jax_function(model(), "q*p + k", NAMES, **RUN)
    square = jax.value_and_grad(lambda *x: mean(*x) ** 2, argnums=(0, 1, 2, 3))
    for run in (square, jax.jit(square)):
        value, found = run(1.3, 0.4, 0.7, jax.numpy.array([0.3]))
        np.testing.assert_allclose(value, right.value**2, rtol=3e-6)
        assert [x.shape for x in found] == [(), (), (), (1,)]
        for x, name in zip(found, NAMES, strict=True):
            np.testing.assert_allclose(np.ravel(x), 2 * right.value * np.ravel(right.values[name]), rtol=2e-5)
    with jax.enable_x64(True):
        value, found = square(1.3, 0.4, 0.7, 0.3)
        assert float(value) == right.value**2
        np.testing.assert_allclose(found[1], 2 * right.value * right.values["sigma"], rtol=1e-13)
        several = jax.vmap(jax.grad(lambda s: mean(1.3, s, q0=0.7, p0=0.3)))(jax.numpy.array([0.4, 0.5]))
        np.testing.assert_allclose(several[0], right.values["sigma"], rtol=1e-13)
        each = ss.jax_function(model(), (cost, slope), ["sigma", "q0"], **RUN, by_path=True)
        sigma, weights = np.linspace(0.2, 0.5, 20), np.linspace(-1, 2, 20)
        found = jax.grad(lambda s: (each(s, 0.7) * weights).sum())(sigma)
        paths = ss.gradient(model(sigma=sigma), (cost, slope), "sigma", **RUN).by_path["sigma"]
        np.testing.assert_allclose(found, weights * paths, rtol=1e-13)


@pytest.mark.parametrize("package", ["torch", "jax"])
def test_refused(package, monkeypatch):
    """Bad input is refused with a sentence, a missing package with the command that installs it."""
    made = getattr(ss, f"{package}_function")
    with monkeypatch.context() as patch:
        patch.setitem(__import__("sys").modules, package, None)
        with pytest.raises(MissingPackageError, match=f"{package} is not installed: pip install"):
            made(model(), "q", **RUN)
        with pytest.raises(MissingPackageError, match=f"{package} is not installed: pip install"):
            getattr(ss, f"{package}_derivative")(cost)
    pytest.importorskip(package)
    with pytest.raises(WrongTypeError, match="f = 'q' is no function"):
        getattr(ss, f"{package}_derivative")("q")
    mean = made(model(), "q", ["k", "q0"], **RUN)
    for given, named in (((1.3,), {}), ((1.3, 0.7, 1.0), {}), ((1.3, 0.7), {"k": 1.0}), ((1.3,), {"p0": 0.7})):
        with pytest.raises(WrongTypeError, match="the function takes k, q0: give each once"):
            mean(*given, **named)
    with pytest.raises(WrongShapeError, match=r"k has shape \(3,\): give \(\) or \(1,\) or \(20,\)"):
        mean([1.0, 1.1, 1.2], 0.7)
    with pytest.raises(WrongShapeError, match=r"q0 has shape \(2,\)"):
        mean(1.3, [0.7, 0.8])
    with pytest.raises(InvalidArgumentError, match="wrt is empty"):
        made(model(), "q", [], **RUN)
    with pytest.raises(WrongTypeError, match="there is no option"):
        made(model(), "q", "k", **RUN, stepp=3)
    with pytest.raises(IncompatibleError, match="compensated"):
        made(model(), "q", "k", **RUN, compensated=True)
