# SPDX-License-Identifier: BSD-3-Clause
"""Symplecticity, action, Euler-Lagrange residuals, exact solutions, convergence."""

import axes
import numpy as np
import pytest
import symsde as ss


@pytest.mark.parametrize("scheme", ["midpoint", "symplectic_euler", "stormer_verlet", "gauss2", "lobatto3"])
def test_symplectic(scheme):
    points = np.linspace(-1, 1, 24).reshape(2, 12)
    defect = ss.diagnose.symplecticity(ss.models.henon_heiles(), scheme, q=points, p=points[::-1], step=0.2, seed=3)
    assert defect.shape == (12,)
    assert defect.max() < 1e-13


@pytest.mark.parametrize("scheme", ["midpoint", "stormer_verlet", "gauss2", "heun"])
def test_symplectic_by_the_tangent_map(scheme):
    """The exact derivative has the defect that differences find: none, or that of heun; also drawn, at t, damped."""
    points = np.linspace(-1, 1, 24).reshape(2, 12)
    given = {"q": points, "p": points[::-1], "step": 0.2, "seed": 3, "t": 0.3}
    model = ss.models.henon_heiles(sigma1=0.3)
    exact, near = (ss.diagnose.symplecticity(model, scheme, by=x, **given) for x in ("tangent", "differences"))
    assert abs(exact - near).max() < 2e-13 and (exact.max() < 1e-13) == (scheme != "heun")
    dw = {"dw": np.linspace(-0.3, 0.3, 24).reshape(2, 12)}
    damped = model.damped(0.7)
    exact, near = (ss.diagnose.symplecticity(damped, scheme, by=x, **given | dw) for x in ("tangent", "differences"))
    assert abs(exact - near).max() < 2e-13 and (exact.max() < 1e-13) == (scheme != "heun")
    steep = ss.model_from_sympy("p**2/2 + cos(80*q)/80", ["0.2*q"])
    steps = {"q": 0.4, "p": 0.2, "step": 0.05, "dw": 0.1}
    if scheme in ("stormer_verlet", "midpoint"):  # waves shorter than the differences, which are wrong here
        assert ss.diagnose.symplecticity(steep, scheme, **steps).max() > 1e-3
        assert ss.diagnose.symplecticity(steep, scheme, by="tangent", **steps).max() < 1e-13
    for wrong, words in (
        ({"model": model.damped([0.5, 0.7])}, "rates that are not equal"),
        ({"scheme": "euler_maruyama"}, "Ito form"),
        ({"by": "tangents"}, "there are tangent, differences"),
    ):
        with pytest.raises(ValueError, match=words):
            ss.diagnose.symplecticity(**{"model": model, "scheme": scheme, "by": "tangent", "step": 0.2} | wrong)


@pytest.mark.parametrize("scheme", ["heun", "euler_maruyama"])
def test_contrasts_are_not_symplectic(scheme):
    defect = ss.diagnose.symplecticity(ss.models.kubo(), scheme, q=1.0, p=0.5, step=0.2, dw=0.3)
    assert defect.max() > 1e-4


def test_euler_lagrange_residuals_and_action():
    run = ss.simulate(ss.models.synchrotron(), q0=0.3, p0=0.0, step=0.02, steps=50, paths=7, seed=2)
    residual = ss.diagnose.euler_lagrange_residual(run)
    assert residual.shape == (4, 7) and residual.max() < 1e-13
    action = ss.diagnose.action(run)
    assert action.shape == (50, 7)
    dw = ss.increments(run.model, step=0.02, steps=50, paths=7, seed=2)
    q, p = ((x[1:, 0] + x[:-1, 0]) / 2 for x in (run.q, run.p))
    hamiltonians = 0.02 * (p**2 / 2 - 4 * np.cos(q)) + dw[:, 0] * 0.2 * np.sin(q) - dw[:, 1] * 0.1 * np.cos(q)
    np.testing.assert_allclose(action, p * np.diff(run.q[:, 0], axis=0) - hamiltonians, rtol=0, atol=1e-15)
    run.q = run.q + 1e-3 * np.sin(np.arange(51.0))[:, None, None]
    assert ss.diagnose.euler_lagrange_residual(run).max() > 1e-5


def test_action_with_refine_and_given_increments(kubo):
    dw = ss.increments(kubo, step=0.01, steps=32, paths=3, seed=2)
    common = {"q0": 1.0, "p0": 0.0, "step": 0.04, "steps": 8, "paths": 3, "refine": 2}
    drawn, given = ss.simulate(kubo, seed=2, **common), ss.simulate(kubo, increments=dw, **common)
    np.testing.assert_array_equal(ss.diagnose.action(drawn), ss.diagnose.action(given))
    assert ss.diagnose.euler_lagrange_residual(given).max() < 1e-14


@pytest.mark.parametrize("scheme", ["midpoint", "symplectic_euler", "gauss2"])
def test_stationary_path_is_that_of_the_scheme(scheme):
    model = ss.models.synchrotron()
    common = {"step": 0.05, "steps": 20, "paths": 9, "seed": 4}
    run = ss.simulate(model, scheme=scheme, q0=0.3, p0=0.5, **common)
    found = ss.diagnose.stationary_path(model, scheme, q_start=0.3, q_end=run.q[-1], **common)
    assert (found.status == 0).all() and found.q.shape == run.q.shape
    np.testing.assert_array_equal(found.t, run.t)
    np.testing.assert_allclose(found.q, run.q, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found.p, run.p, rtol=0, atol=1e-12)
    dw = ss.increments(model, step=0.05, steps=20, paths=9, seed=5)
    other = ss.diagnose.stationary_path(model, scheme, q_start=0.3, q_end=run.q[-1], increments=dw, **common)
    assert abs(other.q - run.q).max() > 1e-3  # another path
    again = ss.diagnose.stationary_path(
        model, scheme, q_start=0.3, q_end=run.q[-1], guess_q=run.q + 0.1, guess_p=run.p - 0.1, **common
    )
    np.testing.assert_allclose(again.p, run.p, rtol=0, atol=1e-12)


def test_stationary_path_has_the_times_of_its_run(kubo):
    later = {"step": 0.25, "steps": 3, "t0": 2.0, "first_step": 4}
    found = ss.diagnose.stationary_path(kubo, q_start=0.3, q_end=0.2, **later)
    np.testing.assert_array_equal(found.t, ss.simulate(kubo, q0=0.3, p0=0.0, **later).t)
    np.testing.assert_array_equal(found.t, [3.0, 3.25, 3.5, 3.75])


def test_stationary_path_of_a_drive_is_that_of_its_time():
    """With a drive that depends on time, the path from step 40 on is found from its two ends."""
    model, common = ss.models.driven_pendulum(), {"step": 0.1, "steps": 5, "first_step": 40, "t0": 0.5, "seed": 3}
    run = ss.simulate(model, q0=0.3, p0=0.1, **common)
    found = ss.diagnose.stationary_path(model, q_start=0.3, q_end=run.q[-1], **common)
    np.testing.assert_allclose(found.p, run.p, rtol=0, atol=1e-11)


@pytest.mark.parametrize(("left", "next_point"), [(0.74, 0.6 + 0.148 / (2 - 2.96)), (0.76, 0.55)])
def test_a_correction_is_halved_that_leaves_three_quarters(left, next_point):
    """Two steps of 1 from q = 0 to 2, U' = 0.8 + c (q - 1/2)^2 below q = 1 and 0 beyond. On the straight line the first
    stage is at q = 1/2, and only one equation is violated; Newton's correction moves the stage by 0.1 and leaves c
    0.01/0.8 of the residual. If this is more than three quarters, half of the correction is tried next; if less, Newton
    goes on from there, where U'' is 0.2 c.
    """
    seen, c = [], left * 80

    def gradient(t, w, q, p):
        if q[0, 0] < 1:
            seen.append(q[0, 0])
        return w[0] * np.where(q < 1, 0.8 + c * (q - 0.5) ** 2, 0.0), w[0] * p

    def hessian(t, w, q, p):
        zero = np.zeros_like(w[:1])[None]
        return (w[0] * np.where(q < 1, 2 * c * (q - 0.5), 0.0))[None], zero, w[:1][None]

    model = ss.Model(ndof=1, nnoise=0, gradient=gradient, hessian=hessian, identity_mass=True, separable=True)
    ss.diagnose.stationary_path(model, q_start=0.0, q_end=2.0, step=1.0, steps=2)
    np.testing.assert_allclose(list(dict.fromkeys(seen))[:3], [0.5, 0.6, next_point], rtol=1e-13)


@pytest.mark.parametrize("given", [("guess_q",), ("guess_p",), ("guess_q", "guess_p")])
def test_a_search_begins_with_the_guesses(given):
    """Two midpoint steps from 0 to 2 begin with positions half way between those of the guess, and its momenta."""
    seen = []

    def gradient(t, w, q, p):
        seen.append((q[0, 0], p[0, 0]))
        return w[0] * np.sin(q), w[0] * p

    model = ss.Model(ndof=1, nnoise=0, gradient=gradient, identity_mass=True, separable=True)
    guess = {"guess_q": np.array([0.0, 1.3, 2.0]), "guess_p": np.array([9.0, 0.7, 0.4])}
    chosen = {name: guess[name][:, None, None] for name in given}
    ss.diagnose.stationary_path(model, q_start=0.0, q_end=2.0, step=0.5, steps=2, **chosen)
    middle = [0.65, 1.65] if "guess_q" in given else [0.5, 1.5]
    speed = [0.7, 0.4] if "guess_p" in given else [2.6, 1.4] if "guess_q" in given else [2.0, 2.0]
    second = next(x for x in seen if x[0] > 1)
    np.testing.assert_allclose([seen[0], second], np.transpose([middle, speed]), rtol=1e-14)


def test_stationary_path_at_a_conjugate_point():
    model = ss.models.linear_oscillator()
    common = {"q_start": 1.0, "q_end": 0.2, "steps": 100, "increments": np.zeros((100, 1))}
    turn = 2 * np.tan(np.pi / 200)  # a hundred midpoint steps are half a turn
    singular = ss.diagnose.stationary_path(model, step=turn, **common)
    assert singular.status[0] == 2 and np.isnan(singular.q).all()
    found = ss.diagnose.stationary_path(model, step=0.9 * turn, **common)
    assert found.status[0] == 0 and found.q[-1, 0, 0] == 0.2


def test_stationary_path_refuses():
    model = ss.models.linear_oscillator()
    common = {"q_start": 1.0, "step": 0.1, "steps": 10}
    with pytest.raises(ValueError, match="not symplectic"):
        ss.diagnose.stationary_path(model, "heun", q_end=0.0, **common)
    with pytest.raises(ss.errors.WrongShapeError, match="q_end"):
        ss.diagnose.stationary_path(model, q_end=[0.0, 1.0], **common)
    with pytest.raises(ss.errors.WrongShapeError, match="guess_p"):
        ss.diagnose.stationary_path(model, q_end=0.0, guess_p=np.zeros((10, 1, 1)), **common)
    with pytest.raises(ss.errors.WrongShapeError, match="increments"):
        ss.diagnose.stationary_path(model, q_end=0.0, increments=np.zeros((9, 1)), **common)
    with pytest.raises(ValueError, match="finite"):
        ss.diagnose.stationary_path(model, q_end=np.nan, **common)


def test_exact_solution_of_kubo(kubo, options):
    run = ss.simulate(kubo, **options)
    q, p = ss.diagnose.exact(run)
    assert q.shape == run.q.shape
    dw = ss.increments(kubo, step=0.05, steps=40, paths=12, seed=7)
    angle = run.t[-1] + 0.3 * dw[:, 0].sum(axis=0)
    np.testing.assert_allclose(q[-1, 0], np.cos(angle), rtol=0, atol=1e-13)
    np.testing.assert_allclose(p[-1, 0], -np.sin(angle), rtol=0, atol=1e-13)


@pytest.mark.parametrize("columns", ["q0", "p0"])
def test_exact_solution_from_columns_beside_one_for_all(kubo, columns):
    """q and p each have a column for each path or one for all paths, as in a run."""
    start = {"q0": 0.7, "p0": 0.4}
    whole = {name: np.full((1, 3), x) for name, x in start.items()}
    whole[columns] = np.array([[0.7, -0.2, 1.1]])
    common = {"step": 0.1, "steps": 5, "paths": 3, "seed": 2}
    expected = ss.diagnose.exact(ss.simulate(kubo, **whole, **common))
    found = ss.diagnose.exact(ss.simulate(kubo, **{**start, columns: whole[columns]}, **common))
    np.testing.assert_array_equal(found, expected)
    np.testing.assert_array_equal([x[0] for x in found], [whole["q0"], whole["p0"]])


def test_convergence_against_the_exact_solution(kubo):
    table = ss.convergence(kubo, "midpoint", q0=1.0, p0=0.0, steps=[16, 32, 64, 128], paths=2000, seed=1)
    assert table.reference == "the exact solution"
    assert table.order_low < table.order < table.order_high < table.order_low + 0.2
    assert abs(table.order - 1) < 0.12
    assert (table.low < table.error).all() and (table.error < table.high).all()
    assert "order" in str(table) and len(str(table).splitlines()) == 7


def test_convergence_against_a_finer_path():
    pendulum = ss.models.pendulum()
    common = {"q0": 1.0, "p0": 0.0, "steps": [16, 32, 64], "paths": 1000, "reference_steps": 1024, "seed": 1}
    table = ss.convergence(pendulum, "symplectic_euler", **common)
    assert abs(table.order - 1) < 0.15 and table.reference == "gauss2_strong32, 1024 steps"
    wrong = ss.convergence(pendulum, "symplectic_euler", correction="none", **common)
    assert wrong.order < 0.5  # converges to another equation


GAUSSIAN = [name for name in ss.schemes.names() if ss.schemes.get(name).info.law == "Gaussian"]


@pytest.mark.parametrize("scheme", GAUSSIAN)
def test_every_scheme_has_its_order_against_the_exact_solution(scheme):
    """The exact solution uses the dZ and K of the run: with other functionals the order would be 0."""
    claimed = ss.schemes.get(scheme).info.orders["additive"].value
    table = ss.convergence(
        ss.models.linear_oscillator(), scheme, q0=0.5, p0=0.2, steps=[8, 16, 32, 64], paths=1000, seed=1
    )
    assert table.reference == "the exact solution" and table.reference_error == 0
    # with noise in p alone and a linear force two schemes of order 1.5 reach order 2
    assert abs(table.order - (2.0 if claimed == 1.5 else claimed)) < 0.1


@pytest.mark.parametrize("scheme", ["midpoint", "verlet_dz", "chin4a"])
def test_exact_solution_is_of_the_halved_path(scheme):
    """refine < 0: a step is halved with all functionals that the scheme draws, and the exact solution uses the same
    halves.
    """
    run = {"q0": 0.5, "p0": 0.2, "paths": 400, "seed": 1, "scheme": scheme, "refine": -2}
    errors = []
    for steps in (32, 64):
        found = ss.simulate(ss.models.linear_oscillator(), step=1 / steps, steps=steps, save_every=steps, **run)
        q, _ = ss.diagnose.exact(found)
        errors.append(np.sqrt(np.mean((q[-1] - found.q[-1]) ** 2)))
    order = ss.schemes.get(scheme).info.orders["additive"].value
    assert abs(np.log2(errors[0] / errors[1]) - order) < 0.35


TURNED = {
    "kubo": lambda sign: ss.models.kubo(sigma=0.5 * sign),
    "linear_oscillator": lambda sign: ss.models.linear_oscillator(sigma=0.5 * sign),
    "additive_oscillator": lambda sign: ss.models.additive_oscillator(sigma=0.5, gamma=0.4 * sign),
}
REVERSED = axes.covering(
    name=tuple(TURNED), scheme=("midpoint", "gauss2_strong32", "gauss_dkdkd"), step=(0.02, 0.7, 5.0), first_step=(0, 7),
    refine=(-1, 0, 1), paths=(1, 3, 40), common=((), (1,)),
)  # fmt: skip


@pytest.mark.parametrize("row", REVERSED, ids=map(axes.ident, REVERSED))
def test_exact_solutions_of_steps_back_are_those_of_steps_with_momenta_turned(row):
    """Steps back have the exact solution of steps forward with reversed momenta: the increments are the same, with
    the opposite sign for noises that act on p.
    """
    q0, p0 = axes.start(1, row["paths"])
    how = {x: row[x] for x in ("first_step", "refine", "paths")} | {"first_path": 5, "seed": 3, "steps": 9}
    how |= {
        "scheme": "midpoint" if row["name"] != "linear_oscillator" else row["scheme"],
        "common_noise": row["common"],
    }
    found = []
    for sign in (1, -1):
        run = ss.simulate(TURNED[row["name"]](sign), q0=q0, p0=sign * p0, step=sign * row["step"], **how)
        q, p = ss.diagnose.exact(run)
        found.append([q, sign * p])
    np.testing.assert_allclose(found[0], found[1], rtol=0, atol=1e-12)
    assert np.ptp(found[0][0]) > 1e-3


@pytest.mark.parametrize(("q", "p"), [(x, y) for x in (-1e9, 1e9) for y in (-1e9, 1e9)])
def test_states_far_to_either_side_are_differenced_in_proportion(q, p):
    """Near 1e9 differences over 1/32 would have rounding errors of 1e-6."""
    model, how = ss.models.linear_oscillator(), {"step": 0.2, "dw": 0.3}
    assert ss.diagnose.symplecticity(model, "midpoint", q=q, p=p, **how).max() < 1e-10


def test_convergence_against_a_reference_that_is_good_enough():
    """Order 1.5 of gauss2_strong32 against chin4a_strong2, 64 times finer; against gauss2 it would be 0.7 to 1.1."""
    model = ss.models.synchrotron(omega=1.0, sigma1=2.0, sigma2=1.0)
    common = {"q0": 0.5, "p0": 0.2, "steps": [16, 32, 64], "paths": 400, "seed": 1}
    table = ss.convergence(model, "gauss2_strong32", **common)
    assert table.reference == "chin4a_strong2, 4096 steps" and 0 < table.reference_error < table.error[-1] / 100
    assert abs(table.order - 1.5) < 0.15 and set(table.status) == {"ok"}
    with pytest.warns(ss.ReferenceWarning, match="reference_steps"):
        poor = ss.convergence(model, "gauss2_strong32", reference="gauss2", reference_steps=2048, **common)
    assert poor.status[-1] == "reference" and poor.reference_error > poor.error[-1] / 4
    assert "at the floor" in str(poor) and "steps counted" in str(poor)


def test_points_at_the_floor_never_count():
    """The slope is fitted to the points above the floor, however many points lie on the floor."""
    model = ss.models.synchrotron()
    common = {"q0": 0.5, "p0": 0.2, "paths": 200, "seed": 1, "reference": "gauss2", "reference_steps": 1024}
    with pytest.warns(ss.ReferenceWarning):
        table = ss.convergence(model, "gauss2_strong32", steps=[2, 4, 8, 64, 128, 256], **common)
    assert table.status[-3:] == ("reference",) * 3
    counted = np.array(table.status) == "ok"
    slope = np.polyfit(np.log(table.step[counted]), np.log(table.error[counted]), 1)[0]
    assert counted.sum() > 1 and table.order == pytest.approx(slope)
    everything = np.polyfit(np.log(table.step), np.log(table.error), 1)[0]
    assert abs(everything - slope) > 0.2  # the twin: a fit to all points has another slope


def test_exact_solutions_refuse_discrete_increments():
    run = ss.simulate(ss.models.linear_oscillator(), q0=1.0, p0=0.0, step=0.1, steps=4, scheme="gauss2_weak2")
    with pytest.raises(ss.errors.IncompatibleError, match="no Brownian path"):
        ss.diagnose.exact(run)


def test_plot(kubo):
    pytest.importorskip("matplotlib")
    (axes,) = ss.convergence(kubo, q0=1.0, p0=0.0, steps=[4, 8], paths=100).plot().axes
    assert axes.get_xscale() == "log" and axes.get_legend() is not None


def test_exact_solutions_follow_the_path_without_truncation(kubo):
    """Truncation belongs to the step: the exact solution uses the increments before truncation."""
    run = {"q0": 1.0, "p0": 0.0, "step": 0.1, "steps": 50, "paths": 200, "seed": 4}
    cut, whole = ss.simulate(kubo, truncation=(2, 1.0), **run), ss.simulate(kubo, **run)
    assert not np.array_equal(cut.q, whole.q)
    for x, y in zip(ss.diagnose.exact(cut), ss.diagnose.exact(whole), strict=True):
        np.testing.assert_array_equal(x, y)


def test_flows_that_nearly_commute_have_no_exact_solution():
    """Brackets of size 0.01: a solution that depends on W alone would have an error of this size."""

    def gradient(t, w, q, p):
        return (w[0] + 1.01 * w[1]) * q, (w[0] + w[1]) * p

    model = ss.Model(ndof=1, nnoise=1, gradient=gradient, quadratic=True)
    run = ss.simulate(model, q0=1.0, p0=0.0, step=0.1, steps=2)
    with pytest.raises(ss.errors.MissingOperationError, match="no exact solution"):
        ss.diagnose.exact(run)
