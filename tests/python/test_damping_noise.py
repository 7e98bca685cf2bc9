# SPDX-License-Identifier: BSD-3-Clause
"""The noise of damped free motion in kicks (`damping_noise`): its exact law, the path's own noise, or polynomial
weights.
"""

import numpy as np
import pytest
import symsde as ss
from symsde.errors import IncompatibleError, UnknownNameError, WrongShapeError

pytestmark = pytest.mark.optimised

KICKS = ("gauss_dkdkd", "verlet_kdk", "chin4a", "gauss_dkdkd_strong2", "verlet_kdk_strong2", "chin4a_strong2")
NOISES = ("law", "law2", "law3", "path", "polynomial")
FREE = ss.model_from_sympy("p**2/2", noise=["-q"])
WELL = ss.model_from_sympy("p**2/2 + q**4/4 - q**2/2", noise=["-s*q"], params={"s": 1.4})
PAIR = ss.model_from_sympy("p1**2/2 + p2**2/3 + cos(q1 - q2) + q1**4/4 + q2**2", noise=["0.6*q1", "-0.5*q2 + 0.2*q1"])
SYNCHROTRON = ss.models.synchrotron(omega=2.0, sigma1=0.8, sigma2=0.5)
START = {"q0": 0.7, "p0": 0.3, "seed": 3}


def ends(model, scheme, power, finest, *, horizon=1.0, **options):
    """Final states over 2^power steps, on the path of 2^finest steps."""
    steps = 2**power
    run = ss.simulate(model, scheme=scheme, step=horizon / steps, steps=steps, save_every=steps, paths=100,
                      refine=finest - power, **START, **options)  # fmt: skip
    assert run.report.status == 0
    return np.concatenate([run.q[-1], run.p[-1]])


def rms(x):
    """Root mean square over paths of a difference of states."""
    return np.sqrt(np.mean(np.sum(x**2, axis=0)))


@pytest.mark.filterwarnings("ignore::symsde.errors.DoubtfulRunWarning")
@pytest.mark.parametrize("scheme", KICKS)
@pytest.mark.parametrize(
    ("rate", "horizon"), [(2.0, 2.0), (1e-12, 1.0), (1e-5, 1.0), (40.0, 1.0), (-1.5, 1.0), (2.0, -1.0)]
)
def test_free_motion_is_the_same_at_all_levels(scheme, rate, horizon):
    """Steps that are sums of 2^6 draws and halves of steps move a free particle alike: D merges, and is halved
    correctly. Kicks with D move a free particle without any other error, so that this is an identity; with noise in law
    it holds in law alone. At gamma h = 40 kicks of gauss_dkdkd are large and opposite, and have larger rounding errors.
    """
    model = FREE.damped(rate, allow_gain=True)
    for levels in (range(7), range(7, 10)):  # sums of draws, and halves of the draws of level 6
        found = [ends(model, scheme, k, 6, horizon=horizon, damping_noise="path") for k in levels]
        known = ends(model, scheme, 6, 6, horizon=horizon, damping_noise="path")
        room = (1e-12 if rate == 40 and "gauss" in scheme else 2e-14) * np.abs(known).max()
        for states in found:
            np.testing.assert_allclose(states, known, rtol=0, atol=room)
    if abs(rate) > 1:
        law = [ends(model, scheme, k, 6, horizon=horizon, damping_noise="law") for k in (0, 6)]
        assert rms(law[0] - law[1]) > 1e-4 * rms(known)


@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize("scheme", ["gauss_dkdkd", "verlet_kdk", "chin4a"])
def test_runs_on_one_path_converge(scheme, noise):
    """Coupled by refinement, steps of 1/8 and 1/32 approach fine ones, at the order of their noise, at weak damping and
    strong. chin4a with law2 has order 2. At gamma = 10 the path's own noise is measured to be better than noise in law.
    """
    errors = {}
    for rate in (1.0, 10.0):
        model = WELL.damped(rate)
        fine = ends(model, "chin4a_strong2", 10, 10, damping_noise="path")
        coarse, finer = (rms(ends(model, scheme, k, 10, damping_noise=noise) - fine) for k in (3, 5))
        order = 3 if scheme == "chin4a" and noise != "law2" else 2
        assert np.log2(coarse / finer) / 2 > order - 0.25
        errors[rate] = coarse
    if noise == "path":
        fine = ends(WELL.damped(10.0), "chin4a_strong2", 10, 10, damping_noise="path")
        by_law = rms(ends(WELL.damped(10.0), scheme, 3, 10) - fine)
        assert errors[10.0] < by_law / {"gauss_dkdkd": 50, "verlet_kdk": 4, "chin4a": 20}[scheme]


def test_the_law_of_the_path():
    """Variances and covariances of E, D, W over steps that are drawn, halved, and summed: 5 standard errors each.

    There are 3 x 18 numbers: a right program fails less than once in 20000 seeds, and this one has its seed.
    """
    rate, h, paths = 3.0, 0.7, 40000
    z = rate * h
    exact = {
        "WW": 1, "WE": (1 - np.exp(-z)) / z, "EE": (1 - np.exp(-2 * z)) / (2 * z), "WD": (z - 1 + np.exp(-z)) / z**2,
        "ED": ((1 - np.exp(-z)) / z) ** 2 / 2, "DD": (2 * z - 3 + 4 * np.exp(-z) - np.exp(-2 * z)) / (2 * z**3),
    }  # fmt: skip
    model = FREE.damped(rate)
    for refine in (0, -1, 2):
        given = {"step": h, "steps": 2, "paths": paths, "scheme": "gauss_dkdkd", "refine": refine, "seed": 5}
        run = ss.simulate(model, q0=0.0, p0=0.0, damping_noise="path", **given)
        E, D = run.p[1:, 0], run.q[1:, 0]
        E, D = (
            np.array([E[0], E[1] - np.exp(-z) * E[0]]),
            np.array([D[0], D[1] - D[0] - (1 - np.exp(-z)) / rate * E[0]]),
        )
        W = E + rate * D
        of = {"W": W / np.sqrt(h), "E": E / np.sqrt(h), "D": D / np.sqrt(h) / h}
        for name, known in exact.items():
            x, y = of[name[0]], of[name[1]]
            room = 5 * np.sqrt((exact[name[0] * 2] * exact[name[1] * 2] + known**2) / paths)
            for k in (0, 1):
                assert abs(np.mean(x[k] * y[k]) - known) < room, (refine, name)
            assert abs(np.mean(x[0] * y[1])) < 5 * np.sqrt(exact[name[0] * 2] * exact[name[1] * 2] / paths)


def columns(fine, h, rate):
    """dW, dZ, K and E of the polygon through increments (part, path) of one row of length h: exact integrals."""
    n = len(fine)
    s, d = np.arange(n + 1) / n, h / n
    W = fine.sum(axis=0)
    Z = h * np.sum((1 - (s[1:] + s[:-1]) / 2)[:, np.newaxis] * fine, axis=0)
    cubic = (s**3 / 3 - s**2 / 2 + s / 6) / 2  # int (s^2 - s + 1/6)/2 ds
    K = n * np.sum(np.diff(cubic)[:, np.newaxis] * fine, axis=0)
    decayed = (np.exp(-rate * h * (1 - s[1:])) - np.exp(-rate * h * (1 - s[:-1]))) / (rate * d)
    E = np.sum(decayed[:, np.newaxis] * fine, axis=0)
    return np.array([W, Z, K, E])


@pytest.mark.parametrize("model", [FREE, WELL, PAIR], ids=["free", "well", "pair"])
def test_columns_are_those_of_the_path(model):
    """Rows of dW, dZ, K and E of a path give the same step as its finer rows."""
    rate, h, steps, parts, m = 4.0, 0.25, 8, 64, model.nnoise
    fine = np.random.default_rng(3).normal(0, np.sqrt(h / parts), (steps * parts, m, 20))
    row = [[columns(fine[parts * n : parts * (n + 1), k], h, rate) for k in range(m)] for n in range(steps)]
    coarse = np.array(row).transpose(0, 2, 1, 3).reshape(steps, 4 * m, 20)
    for scheme in ("gauss_dkdkd", "verlet_kdk", "chin4a"):
        given = {
            "q0": 0.7,
            "p0": 0.3,
            "step": h,
            "steps": steps,
            "scheme": scheme,
            "paths": 20,
            "damping_noise": "path",
        }
        damped = model.damped(rate)
        one = ss.simulate(damped, increments=coarse, **given)
        other = ss.simulate(damped, increments=fine, refine=6, **given)
        np.testing.assert_allclose(one.q, other.q, rtol=0, atol=1e-12)
        np.testing.assert_allclose(one.p, other.p, rtol=0, atol=1e-12)
        # E is read: without E, D is that of the cubic path, and the difference has mean zero
        cubic = ss.simulate(damped, increments=coarse[:, : 3 * m], **given)
        assert 1e-6 < np.abs(cubic.q - one.q).max() < 1e-2
        wrong = coarse.copy()
        wrong[:, 3 * m :] *= 1.01
        assert np.abs(ss.simulate(damped, increments=wrong, **given).q - one.q).max() > 1e-4
    if model is FREE:  # every step of a free particle is p <- exp(-z) p + E, q <- q + phi p + (W - E)/gamma
        p, q = np.full(20, 0.3), np.full(20, 0.7)
        for n in range(steps):
            q += (1 - np.exp(-rate * h)) / rate * p + (coarse[n, 0] - coarse[n, 3]) / rate
            p = np.exp(-rate * h) * p + coarse[n, 3]
        np.testing.assert_allclose([one.q[-1, 0], one.p[-1, 0]], [q, p], rtol=0, atol=1e-13)


@pytest.mark.parametrize("h", [0.25, -0.25])
def test_columns_move_free_particles_forth_and_back(h):
    """p <- exp(-z) p + E and q <- q + phi p + (W - E)/gamma, also where momenta grow."""
    rate, fine = 4.0, np.random.default_rng(5).normal(0, np.sqrt(abs(h) / 64), (64, 5))
    w, _, _, e = row = columns(fine, h, rate)
    given = {"q0": 0.7, "p0": 0.3, "step": h, "steps": 1, "paths": 5, "damping_noise": "path"}
    for scheme in ("gauss_dkdkd", "chin4a"):
        run = ss.simulate(FREE.damped(rate), increments=row[np.newaxis], scheme=scheme, **given)
        wanted = [0.7 + (1 - np.exp(-rate * h)) / rate * 0.3 + (w - e) / rate, np.exp(-rate * h) * 0.3 + e]
        np.testing.assert_allclose([run.q[-1, 0], run.p[-1, 0]], wanted, rtol=0, atol=1e-14)


@pytest.mark.parametrize("rate", [1e-9, 1e-6])
def test_columns_at_weak_damping(rate):
    """At weak damping E and dW agree in nearly all digits; D is taken from dW, dZ and K, which loses no digits."""
    fine = np.random.default_rng(4).normal(0, 0.1, (64, 1, 5))
    coarse = columns(fine[:, 0], 0.5, rate)[np.newaxis]
    given = {
        "q0": 0.0,
        "p0": 0.0,
        "step": 0.5,
        "steps": 1,
        "scheme": "gauss_dkdkd",
        "paths": 5,
        "damping_noise": "path",
    }
    one = ss.simulate(FREE.damped(rate), increments=coarse, **given)
    other = ss.simulate(FREE.damped(rate), increments=fine, refine=6, **given)
    np.testing.assert_allclose(one.q, other.q, rtol=0, atol=1e-14)


@pytest.mark.parametrize("scheme", ["gauss_dkdkd", "chin4a_strong2"])
@pytest.mark.parametrize("noise", ["law3", "path"])
def test_bits(scheme, noise):
    """A path has the same bits alone, in blocks of any width, when resumed, and beside common noises; for every
    choice.
    """
    model = SYNCHROTRON.damped(0.8)
    for refine in (0, 1, -2):
        given = {**START, "step": 0.1, "scheme": scheme, "damping_noise": noise, "refine": refine}
        whole = ss.simulate(model, steps=12, paths=300, **given)
        for path in (0, 7, 299):
            alone = ss.simulate(model, steps=12, paths=1, first_path=path, **given)
            np.testing.assert_array_equal(whole.q[..., path], alone.q[..., 0])
            np.testing.assert_array_equal(whole.p[..., path], alone.p[..., 0])
        narrow = ss.simulate(model, steps=12, paths=300, lanes=8, threads=2, **given)
        np.testing.assert_array_equal(whole.q, narrow.q)
        for first in (5, 6):
            begun = ss.simulate(model, steps=first, paths=300, **given)
            went_on = begun.extend(12 - first)
            np.testing.assert_array_equal(whole.q[first:], went_on.q[-(13 - first) :])
        common = ss.simulate(model, steps=12, paths=4, first_path=3, common_noise=2, **given)
        assert (common.q[-1] != whole.q[-1, :, 3:7]).all()
        moments = ss.moments(model, steps=12, save_every=12, paths=300, **given)
        np.testing.assert_allclose(moments.mean_q[-1], whole.q[-1].mean(axis=-1), rtol=1e-13)


@pytest.mark.parametrize("noise", NOISES)
def test_constant_forces_are_exact(noise):
    """q + p/gamma advances by (h F + sigma W)/gamma for every choice: terminal velocity and free diffusion."""
    rate, h, force = 2.5, 0.8, 0.7
    model = ss.model_from_sympy("p**2/2 - f*q", noise=["-s*q"], params={"f": force, "s": 1.3}).damped(rate)
    given = {"seed": 2, "step": h, "steps": 10, "paths": 9}
    for scheme in ("gauss_dkdkd", "verlet_kdk", "chin4a"):
        run = ss.simulate(model, q0=0.2, p0=0.1, scheme=scheme, damping_noise=noise, **given)
        W = ss.increments(model, scheme=scheme, **given).sum(axis=0)
        moved = np.diff(run.q[[0, -1], 0] + run.p[[0, -1], 0] / rate, axis=0)[0]
        np.testing.assert_allclose(moved, (10 * h * force + 1.3 * W[0]) / rate, rtol=0, atol=1e-13)


def test_temperature_of_a_free_particle():
    """With noise in law and of the path <p^2> = 1/(2 gamma) for every step; polynomial weights lose a quarter at gamma
    h = 4.

    The weights are found by one step from rest on dW and dZ each, so that nothing is sampled.
    """
    rate, h = 4.0, 1.0
    model = FREE.damped(rate)
    variance = {}
    for noise in NOISES:
        many = {"law": 2, "law2": 2, "law3": 3, "path": 4, "polynomial": 2}[noise]
        given = {"q0": 0.0, "p0": 0.0, "step": h, "steps": 1, "scheme": "gauss_dkdkd", "damping_noise": noise}
        rows = np.zeros((1, many, 3))
        rows[0, 0, 0] = rows[0, 1, 1] = 1
        rows[0, 1, 0] = 0.5  # dZ of dW = 1 with a = 0
        if many > 2:
            rows[0, 2, 2] = 1
        if many > 3:
            rows[0, 3] = [0.2, 0.3, 0.4]
        p = ss.simulate(model, increments=rows, paths=3, **given).p[-1, 0]
        if noise == "path":
            np.testing.assert_allclose(p, [0.2, 0.3, 0.4], rtol=0, atol=1e-14)
            continue
        variance[noise] = (p[0] ** 2 + p[1] ** 2 / 12 + (p[2] ** 2 / 720 if many > 2 else 0)) / (
            1 - np.exp(-2 * rate * h)
        )
    assert variance["law"] == variance["law2"]
    assert variance["law2"] * 2 * rate == pytest.approx(1, abs=1e-13)
    assert variance["law3"] * 2 * rate == pytest.approx(1, abs=1e-13)
    assert variance["polynomial"] * 2 * rate == pytest.approx(0.75, abs=0.01)


def test_truncation_bounds_the_normal_of_the_path():
    """A wide bound changes nothing but rounding; a narrow one keeps E, D and W of a free particle within bounds."""
    model = FREE.damped(3.0)
    given = {"q0": 0.0, "p0": 0.0, "step": 0.2, "steps": 40, "paths": 50, "scheme": "gauss_dkdkd", "seed": 1}
    for refine in (0, 1, -1):
        plain = ss.simulate(model, damping_noise="path", refine=refine, **given)
        wide = ss.simulate(model, damping_noise="path", refine=refine, truncation=(90.0, 1.0), **given)
        np.testing.assert_allclose(wide.q, plain.q, rtol=0, atol=1e-13)
        narrow = ss.simulate(model, damping_noise="path", refine=refine, truncation=(2.8, 1.0), **given)
        assert 1e-4 < np.abs(narrow.q - plain.q).max() < 0.5


def test_no_damping_and_no_choice_change_no_bit():
    """The default is the law of the scheme; only the noise of the path draws E, and files name a choice that is not
    the default.
    """
    model = WELL.damped(0.5)
    given = {**START, "step": 0.1, "steps": 8, "paths": 20}
    for scheme, law in (("gauss_dkdkd", "law2"), ("verlet_kdk", "law2"), ("chin4a", "law3")):
        runs = [ss.simulate(model, scheme=scheme, damping_noise=x, **given) for x in ("law", law)]
        np.testing.assert_array_equal(runs[0].q, runs[1].q)
        assert [run.report.functionals for run in runs] == [("dZ",) if law == "law2" else ("dZ", "K")] * 2
        path = ss.simulate(model, scheme=scheme, damping_noise="path", **given)
        assert path.report.functionals == ("dZ", "K", "E")
        assert (
            "damping_noise" in path.attributes()["options"] and "damping_noise" not in runs[0].attributes()["options"]
        )


def test_refusals():
    """Refused: a choice without effect, and columns that nothing reads."""
    given = {**START, "step": 0.1, "steps": 2, "damping_noise": "path"}
    with pytest.raises(IncompatibleError, match="not damped"):
        ss.simulate(WELL, scheme="gauss_dkdkd", **given)
    with pytest.raises(IncompatibleError, match="midpoint has no kicks"):
        ss.simulate(WELL.damped(1.0), scheme="midpoint", **given)
    with pytest.raises(IncompatibleError, match="with one rate alone"):
        ss.simulate(PAIR.damped([1.0, 2.0]), scheme="gauss_dkdkd", **given)
    with pytest.raises(IncompatibleError, match="no single rate"):
        ss.simulate(SYNCHROTRON.damped(lambda t: 1.0 + t), scheme="gauss_dkdkd", **given)
    with pytest.raises(IncompatibleError, match="no kicks"):
        ss.simulate(FREE.damped(1.0), scheme=ss.schemes.from_word("BAOAB"), **given)
    with pytest.raises(UnknownNameError, match="law3"):
        ss.simulate(WELL.damped(1.0), scheme="gauss_dkdkd", **{**given, "damping_noise": "law4"})
    rows = np.zeros((2, 4, 1))
    with pytest.raises(IncompatibleError, match=r"among them .*E"):
        ss.simulate(WELL.damped(1.0), scheme="chin4a", increments=rows, **{**given, "damping_noise": "law"})
    with pytest.raises(WrongShapeError, match="of E"):
        ss.simulate(WELL.damped(1.0), scheme="chin4a", increments=np.zeros((2, 5, 1)), **given)
    with pytest.raises(IncompatibleError, match="K"):
        ss.simulate(WELL.damped(1.0), scheme="gauss_dkdkd", increments=rows[:, :2], **given)
