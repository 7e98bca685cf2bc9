# SPDX-License-Identifier: BSD-3-Clause
"""Derivatives by parameters of sums over sites and over pairs: equal to differences, and to formulas written out."""

import numpy as np
import pytest
import symsde as ss
from symsde.errors import IncompatibleError, WrongShapeError

pytest.importorskip("sympy")

from symsde.model.formulas import compiler
from symsde.run.hooks import _Call

if compiler.command() is None:
    pytest.skip("no C compiler", allow_module_level=True)

pytestmark = pytest.mark.usefixtures("quick_compiler")
SITES = 5
SPRINGS = np.linspace(0.5, 1.5, SITES)
STENCIL = ((1, 3 / 4), (2, -3 / 20), (3, 1 / 60))  #: a central difference of sixth order
RUN = {"q0": np.linspace(-0.5, 0.5, SITES), "p0": np.linspace(0.3, -0.2, SITES), "step": 0.1, "steps": 12, "paths": 5}
ENDS = {
    "free": ["k[i]*(q[i+1]-q[i])**2/2 + b*(q[i+1]-q[i])**4/4", "b*k[i]*q[i]**2/2"],
    "fixed": ["(q[i+1]-q[i])**2/2 + b*(q[i+1]-q[i])**4/4", "k[i]*q[i]**2/2"],
    "periodic": ["k[i+1]*(q[i+1]-q[i])**2/2 + b*(q[i+2]-q[i])**4/4"],
}


def chain(ends="free", **values):
    """Springs, each with its own constant, and noise that holds it, too."""
    H = " + ".join(["Sum(p[i]**2/2, i)", *(f"Sum({x}, i)" for x in ENDS[ends])])
    params = {"s": 0.3, "k": SPRINGS, "b": 0.7} | values
    return ss.model_from_sympy(H, noise=["s*k[j]*sin(q[j])"], n=SITES, ends=ends, params=params)


def moved(name, by, site=None):
    """Values of the chain of which one is moved."""
    if site is None:
        return {name: {"s": 0.3, "b": 0.7}[name] + by}
    springs = SPRINGS.copy()
    springs[site] += by
    return {name: springs}


def differences(make, f, **run):
    """Differences of f of each path; make(h) moves a parameter by h."""
    sides = ((x / 3e-3, [ss.gradient(make(i * d), f, ["q0"], **run).f for d in (3e-3, -3e-3)]) for i, x in STENCIL)
    return sum(x * (a - b) for x, (a, b) in sides)


@pytest.mark.parametrize("scheme", ["stormer_verlet", "midpoint", "chin4a", "lobatto3"])
@pytest.mark.parametrize("ends", ENDS)
def test_parameters_of_sites(ends, scheme):
    """Every derivative is right to 1e-9 of the largest of its kind, whatever the ends, and so are tangents."""
    f, run = "q_1**2 + q_3*p_2 + b*p_4", RUN | {"scheme": scheme}
    found = ss.gradient(chain(ends), f, ["b", "k", "s"], **run)
    maps = ss.tangent(chain(ends), ["k"], **run)
    mine = found.by_path["k"]
    assert mine.shape == (SITES, 5) and found.values["k"].shape == found.se["k"].shape == (SITES,)
    for name, site in (("s", None), ("b", None), ("k", 0), ("k", 3)):
        right = differences(lambda h: chain(ends, **moved(name, h, site)), f, **run)  # noqa: B023
        row = found.by_path[name] if site is None else mine[site]
        assert abs(row - right).max() < 1e-9 * max(abs(right).max(), 0.1)
        assert abs(right).max() > 1e-3
    q, p, by = maps.q, maps.p, maps.by["k"]
    along = 2 * q[0] * by[:, 0] + q[2] * by[:, SITES + 1] + p[1] * by[:, 2] + 0.7 * by[:, SITES + 3]
    np.testing.assert_allclose(along, mine, rtol=1e-11, atol=1e-13)


BODIES = "Sum((u[i]**2 + v[i]**2)/(2*m[i]), i) - Sum(G*m[i]*m[j]/sqrt((x[i]-x[j])**2 + (y[i]-y[j])**2 + 0.1), i < j)"
MASSES = np.array([0.7, 1.0, 1.4])
STATE = {"q0": [0.0, 0.1, 1.0, 0.9, -1.0, 0.3], "p0": [0.1, 0.3, -0.3, 0.2, 0.1, -0.3], "step": 0.1, "steps": 8}


def bodies(masses=MASSES, G=1.1):
    """Bodies in the plane, whose masses are parameters of sites; two coordinates of a site."""
    given = {"params": {"m": masses, "G": G, "s": 0.2}, "n": 3, "q": "x y", "p": "u v"}
    return ss.model_from_sympy(BODIES, noise=["s*m[k]*x[k]"], **given)


def written_out(masses=MASSES):
    """The same, body by body."""
    x, y, u, v, m = ([f"{a}{i}" for i in range(1, 4)] for a in "xyuvm")
    H = " + ".join(f"({u[i]}**2 + {v[i]}**2)/(2*{m[i]})" for i in range(3))
    for i, j in ((0, 1), (0, 2), (1, 2)):
        H += f" - G*{m[i]}*{m[j]}/sqrt(({x[i]}-{x[j]})**2 + ({y[i]}-{y[j]})**2 + 0.1)"
    names = {"q": [a for both in zip(x, y, strict=True) for a in both]}
    names["p"] = [a for both in zip(u, v, strict=True) for a in both]
    params = dict(zip(m, masses, strict=True)) | {"G": 1.1, "s": 0.2}
    return ss.model_from_sympy(H, noise=[f"s*{m[i]}*{x[i]}" for i in range(3)], params=params, **names)


@pytest.mark.parametrize(("scheme", "paths"), [("stormer_verlet", 1), ("midpoint", 7), ("gauss2", 20)])
def test_pairs(scheme, paths):
    """Masses of bodies in pairs and in kinetic energies, as formulas written out have them; single paths, too."""
    run = STATE | {"paths": paths, "scheme": scheme}
    mine = ss.gradient(bodies(), "q_1*p_4 + q_6", ["G", "m", "s", "q0"], **run)
    theirs = ss.gradient(written_out(), "q_1*p_4 + q_6", ["G", "m1", "m2", "m3", "s", "q0"], **run)
    for name in ("G", "s", "q0"):
        np.testing.assert_allclose(mine.by_path[name], theirs.by_path[name], rtol=1e-9, atol=1e-11)
    for k in range(3):
        np.testing.assert_allclose(mine.by_path["m"][k], theirs.by_path[f"m{k + 1}"], rtol=1e-9, atol=1e-11)


def test_functions_of_the_path():
    """Derivatives by parameters that f holds itself come in the order of wrt, a row for each site."""
    rows = np.arange(1.0, 7.0)[:, np.newaxis] * np.ones(5)
    pair = (lambda t, q, p: q[-1, 0], lambda t, q, p: (_first(q), 0 * p, rows))
    bare = (pair[0], lambda t, q, p: (_first(q), 0 * p))
    run = RUN | {"scheme": "stormer_verlet"}
    held, plain = (ss.gradient(chain(), x, ["b", "k"], **run).by_path for x in (pair, bare))
    np.testing.assert_allclose(held["b"] - plain["b"], rows[0], rtol=1e-12)
    np.testing.assert_allclose(held["k"] - plain["k"], rows[1:], rtol=1e-12)
    short = (pair[0], lambda t, q, p: (_first(q), 0 * p, rows[:2]))
    with pytest.raises(WrongShapeError, match=r"return \(6, 5\)"):
        ss.gradient(chain(), short, ["b", "k"], **run)


def _first(q):
    slope = np.zeros_like(q)
    slope[-1, 0] = 1
    return slope


def test_fit():
    """Constants of all springs are found from the motion of all sites."""
    pytest.importorskip("scipy")
    still = {"s": 0.0, "b": 0.2}
    run = {x: RUN[x] for x in ("q0", "p0", "step")} | {"scheme": "stormer_verlet"}
    truth = ss.simulate(chain(**still), **run, steps=60)
    data = {f"q_{i + 1}": truth.q[10::10, i, 0] for i in range(SITES)}
    start = chain(**still, k=np.ones(SITES))
    found = ss.fit(start, data, ["k"], t=truth.t[10::10], **run, paths=2)
    np.testing.assert_allclose(found.values["k"], SPRINGS, rtol=1e-7)
    assert found.columns == tuple(f"k[{i}]" for i in range(SITES)) and found.values["k"].shape == (SITES,)


def by_differences(make, begin=lambda h: {}, **run):
    """Derivative of q_1^2 + q_3 p_2 of each path, by the runs themselves; make(h), or begin(h), is moved by h."""

    def f(h):
        found = ss.simulate(make(h), **run | begin(h))
        return found.last_q[0] ** 2 + found.last_q[2] * found.last_p[1]

    return sum(x / 3e-3 * (f(i * 3e-3) - f(-i * 3e-3)) for i, x in STENCIL)


def require_right(make, values, names, **run):
    """Derivatives by numbers, and by the third site of arrays, are right to 1e-9 of differences."""
    found = ss.gradient(make(), "q_1**2 + q_3*p_2", [*names, "q0"], **run)
    right = by_differences(lambda h: make(), lambda h: {"q0": run["q0"] + h * np.eye(SITES)[1]}, **run)
    assert abs(found.by_path["q0"][1] - right).max() < 1e-9 * abs(right).max()
    for name in names:
        here = values[name]
        step = np.eye(SITES)[2] if np.ndim(here) else 1.0
        right = by_differences(lambda h: make(**{name: here + h * step}), **run)  # noqa: B023
        mine = found.by_path[name][2] if np.ndim(here) else found.by_path[name]
        assert abs(right).max() > 1e-4 and abs(mine - right).max() < 1e-9 * max(abs(right).max(), 0.1), name


COUPLED = {"J": 0.3, "a": 0.4, "s": 0.2, "k": SPRINGS}


def coupled(**values):
    """Functions of sums in H and in a noise, with parameters inside and outside of the sums."""
    H = "Sum(p[i]**2/2 + k[i]*q[i]**2/2, i) + J*Sum(k[i]*q[i], i)**2 + a*sin(a*Sum(cos(q[i]), i)/5)"
    noise = ["s*q[j]", "0.3*a*exp(J*Sum(q[i], i)/5)"]
    return ss.model_from_sympy(H, noise, n=SITES, params=COUPLED | values)


@pytest.mark.parametrize("scheme", ["stormer_verlet", "midpoint", "gauss2", "gauss_dkdkd"])
def test_functions_of_sums(scheme):
    """Parameters of functions of sums are sums of one term."""
    run = RUN | {"scheme": scheme}
    require_right(coupled, COUPLED, list(COUPLED), **run)
    maps, found = ss.tangent(coupled(), ["J", "k"], **run), ss.gradient(coupled(), "q_1", ["J", "k"], **run)
    np.testing.assert_allclose(maps.by["J"][0], found.by_path["J"], rtol=1e-11, atol=1e-13)
    np.testing.assert_allclose(maps.by["k"][:, 0], found.by_path["k"], rtol=1e-11, atol=1e-13)


def pull(q, p, t):
    """A force of neighbours, and drag."""
    return -0.3 * p**3 + 0.1 * np.roll(q, 1, axis=0)


def slopes_of_pull(q, p, t):
    """Its derivatives."""
    unit = np.eye(SITES)[:, :, np.newaxis]
    return 0.1 * np.roll(unit, -1, axis=0) + 0 * q, -0.9 * unit * p**2


def shake(q, p, t):
    """A force of each noise."""
    return 0.1 * np.eye(SITES)[:, :, np.newaxis] * np.cos(p)


def slopes_of_shake(q, p, t):
    """Its derivatives."""
    one = np.einsum("ki,kj->kji", np.eye(SITES), np.eye(SITES))[..., np.newaxis]
    return 0 * one, -0.1 * one * np.sin(p)


HEAVY = {"s": 0.3, "k": SPRINGS, "b": 0.7, "m": np.linspace(1.0, 1.5, SITES)}


def heavy(noise="s*k[j]*sin(q[j])", **values):
    """A chain of masses."""
    H = "Sum(p[i]**2/(2*m[i]) + k[i]*q[i]**2/2, i) + Sum(b*(q[i+1]-q[i])**4/4, i)"
    return ss.model_from_sympy(H, [noise], n=SITES, params=HEAVY | values)


@pytest.mark.parametrize("scheme", ["midpoint", "stormer_verlet", "gauss2"])
def test_forces(scheme):
    """Forces that are functions hold no parameters, and stand beside those of sites."""
    forces = {"force": pull, "force_derivative": slopes_of_pull}
    forces |= {"noise_force": shake, "noise_force_derivative": slopes_of_shake}
    run = RUN | {"scheme": scheme}
    require_right(lambda **x: heavy(**x).forced(**forces), HEAVY, ["b", "k", "m"], **run)
    for noise in ("s*k[j]*sin(q[j])", "s*k[j]*q[j]"):  # the friction of noises is a force, or damping
        require_right(lambda **x: ss.thermostat(heavy(noise, **x), beta=2.0), HEAVY, list(HEAVY), **run)  # noqa: B023


@pytest.mark.filterwarnings("ignore::symsde.errors.OwnNoiseWarning")
@pytest.mark.parametrize("scheme", ["midpoint", "stormer_verlet", "chin4a"])
def test_baths(scheme):
    """Baths whose noises the library adds."""

    def bathed(gamma, **values):
        return ss.thermostat(heavy(**values), beta=2.0, gamma=gamma)

    run = RUN | {"scheme": scheme}
    require_right(lambda **x: bathed(0.3, **x), HEAVY, ["b", "k", "s"], **run)
    with pytest.raises(IncompatibleError, match="noises of the bath of model formula would change with m"):
        ss.gradient(bathed(0.3), "q_1", ["m"], **run)
    if scheme != "chin4a":
        require_right(lambda **x: bathed(np.linspace(0.1, 0.4, SITES), **x), HEAVY, ["k"], **run)
    names = {"n": SITES, "q": "x y", "p": "u v", "params": {"k": 1.3}}
    plane = ss.model_from_sympy("Sum((u[i]**2+v[i]**2)/2 + k*x[i]**2*y[i]**2, i)", **names)
    state = {"q0": 0.5, "p0": 0.1, "step": 0.1, "steps": 2, "scheme": scheme}
    with pytest.raises(IncompatibleError, match="a noise for each coordinate of each site in turn"):
        ss.gradient(ss.thermostat(plane, beta=2.0, gamma=0.3), "x_1", ["k"], **state)


OF_SUMS = {
    "one": "Sum(p[i]**2/2 + k[i]*q[i]**2/2, i)",
    "neighbours": "b*Sum(k[i]*(q[i+1] - q[i])**2, i)*Sum(q[i]*p[i], i) + s*q_2 + p_4**2",
    "beside": "Sum(cos(q[i] - q_3)*p_2*k[i], i) + Sum(q_1*p_4*sin(q[i] - q[j]), i < j)",
    "pairs": "exp(Sum(k[i]*k[j]*cos(q[i] - b*q[j]), i < j)/20 - t*q_1)",
}


@pytest.mark.parametrize("f", OF_SUMS.values(), ids=OF_SUMS)
@pytest.mark.parametrize("ends", ["free", "periodic"])
def test_f_of_sums(ends, f):
    """f may be a function of sums, of single coordinates and of parameters beside them; it has the value of the
    observable.
    """
    run = RUN | {"scheme": "stormer_verlet"}
    found = ss.gradient(chain(ends), f, ["b", "s", "k", "q0", "p0"], **run)
    value = ss.moments(chain(ends), **run, save_every=12, observables={"f": f}).mean["f"][-1]
    np.testing.assert_allclose(found.value, value, rtol=1e-13)
    for name, site in (("s", None), ("b", None), ("k", 0), ("k", 3)):
        right = differences(lambda h: chain(ends, **moved(name, h, site)), f, **run)  # noqa: B023
        mine = found.by_path[name] if site is None else found.by_path[name][site]
        assert abs(right).max() > 1e-4 and abs(mine - right).max() < 1e-9 * max(abs(right).max(), 0.1), name
    for name in ("q0", "p0"):
        at = [run | {name: run[name] + h * np.eye(SITES)[3]} for i, _ in STENCIL for h in (i * 3e-3, -i * 3e-3)]
        sides = [ss.gradient(chain(ends), f, ["q0"], **x).f for x in at]
        right = sum(w * (sides[2 * k] - sides[2 * k + 1]) / 3e-3 for k, (_, w) in enumerate(STENCIL))
        assert abs(found.by_path[name][3] - right).max() < 1e-9 * abs(right).max()


def test_f_of_sums_of_other_models():
    """Sums over the coordinates of any model, over sites of two coordinates, and what has no derivative."""
    run = {"q0": [0.1, 0.2], "p0": [0.1, 0.3], "step": 0.1, "steps": 5, "paths": 4}
    for mine, theirs in (("Sum(q[i]**2, i) + q_1*Sum(p[i], i)", "q_1**2 + q_2**2 + q_1*(p_1 + p_2)"),):
        one, other = (ss.gradient(ss.models.henon_heiles(), f, ["alpha", "q0", "p0"], **run) for f in (mine, theirs))
        for name in one.by_path:
            np.testing.assert_allclose(one.by_path[name], other.by_path[name], rtol=1e-12, atol=1e-14)
    f = "Sum(m[i]*(x[i]*v[i] - y[i]*u[i]), i) + Sum(G*m[i]*m[j]*(x[i] - x[j])**2, i < j) + y_2"
    # written out for three bodies, whose coordinates are x1, y1, x2, ..
    out = "+".join(f"m{i}*(q_{2 * i - 1}*p_{2 * i} - q_{2 * i}*p_{2 * i - 1})" for i in (1, 2, 3)) + "+ q_4"
    out += "".join(f"+ G*m{i}*m{j}*(q_{2 * i - 1} - q_{2 * j - 1})**2" for i, j in ((1, 2), (1, 3), (2, 3)))
    mine = ss.gradient(bodies(), f, ["G", "m", "q0", "p0"], **STATE, paths=3)
    theirs = ss.gradient(written_out(), out, ["G", "m1", "m2", "m3", "q0", "p0"], **STATE, paths=3)
    for name in ("G", "q0", "p0"):
        np.testing.assert_allclose(mine.by_path[name], theirs.by_path[name], rtol=1e-9, atol=1e-11)
    for k in range(3):
        np.testing.assert_allclose(mine.by_path["m"][k], theirs.by_path[f"m{k + 1}"], rtol=1e-9, atol=1e-11)
    with pytest.raises(IncompatibleError, match="has no derivative by q"):
        ss.gradient(chain(), "Sum(floor(q[i]), i)", ["b"], **RUN)
    with pytest.raises(IncompatibleError, match="17 different sums in products: allowed are 16"):
        ss.gradient(chain(), "+".join(f"sin(Sum(q[i]**{k}, i))" for k in range(1, 18)), ["b"], **RUN)


def test_functions_of_other_packages():
    """The functions for torch and jax take (site,), and give derivatives of the sum over paths."""
    given = {**RUN, "scheme": "stormer_verlet"}
    call = _Call(chain(), "q_1**2", ["k", "s"], given, by_path=False)
    value, of_k, _ = call.run([SPRINGS, np.array(0.3)])
    found = ss.gradient(chain(), "q_1**2", ["k", "s"], **given)
    assert value == found.value and of_k.shape == call.rows("k") == (SITES, 5) and call.rows("s") == (5,)
    np.testing.assert_allclose(call.pulled(of_k, 1.0, (SITES,)), found.values["k"], rtol=1e-13)
    with pytest.raises(WrongShapeError, match=r"k has shape \(3,\): give \(5,\)"):
        call.run([SPRINGS[:3], np.array(0.3)])
