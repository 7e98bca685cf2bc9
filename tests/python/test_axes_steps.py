# SPDX-License-Identifier: BSD-3-Clause
"""Every scheme along all axes against its equations in NumPy (reference.py): block, general stepper, single path."""

import axes
import numpy as np
import pytest
import reference
import symsde as ss

TABLEAUS = (
    "midpoint", "stormer_verlet", "gauss2", "gauss3", "gauss4", "lobatto2_swapped", "lobatto3", "lobatto3_swapped",
    "lobatto4", "lobatto4_swapped", "P2N2Q2Otr", "dirk:0.25", "heun", "euler_maruyama", "midpoint_weak1",
)  # fmt: skip
BRACKETS = ("gauss2_strong32", "gauss2_strong32_areas", "gauss2_weak2", "gauss2_weak2_areas", "midpoint_areas")
ONE_SIDED = ("symplectic_euler", "symplectic_euler_adjoint", "lambda:0.3")
GALERKIN = ("P1N2Q2Lob", "P1N2Q2Otr", "P1N2Q4Gau", "P1N3Q4Lob", "P2N3Q4Lob", "P2N3Q6Gau", "P2N4Q6Lob")
KICKS = ("gauss_dkdkd", "verlet_kdk", "chin4a", "gauss_dkdkd_strong2", "verlet_kdk_strong2", "chin4a_strong2",
         "verlet_kdk_midpoint", "verlet_dkd_weak2")  # fmt: skip
KINDS = {
    **dict.fromkeys(TABLEAUS + BRACKETS + ONE_SIDED, tuple(axes.TRAITS)),
    **dict.fromkeys(GALERKIN, ("kick", "both", "moved", "position", "mass", "any")),
    **dict.fromkeys(KICKS, ("kick", "position", "mass")),
    "gauss_dkdkd_midpoint": ("kick", "position", "mass", "any"),
    "gauss_dkdkd_rotation": ("kick", "position"),
    "exact_rotation": ("kick", "position"),
    "averaged_shift_midpoint": ("kick", "both", "moved"),
    "verlet_dz": ("kick",),
    "drift_preserving": ("kick",),
}
NO_GENERAL = {"verlet_dz", "averaged_shift_midpoint", "drift_preserving", "exact_rotation"}
STEPS, ROWS, PATHS = 2, 4, 5


#: kinds of models without third derivatives, whose nested brackets are differences
DIFFERENCES = ("both", "mass", "separable", "coupled")


def design(scheme):
    """Rows for a scheme; the axis `of one kind` is (kind, whether third derivatives exist)."""
    chosen = {**axes.AXES, "kind": tuple((kind, True) for kind in KINDS[scheme])}
    if scheme in {*BRACKETS[:4], "averaged_shift_midpoint"}:
        chosen["kind"] += tuple((kind, False) for kind in KINDS[scheme] if kind in DIFFERENCES)
    if scheme in ONE_SIDED:
        chosen["correction"] = ("auto", "mean", "none")
    rows = axes.covering(**chosen)
    return [{**row, "kind": row["kind"][0], "third": row["kind"][1]} for row in rows]


CASES = [(scheme, row) for scheme in KINDS for row in design(scheme)]


@pytest.mark.parametrize(("scheme", "row"), CASES, ids=[f"{scheme}-{axes.ident(row)}" for scheme, row in CASES])
def test_steps_are_those_of_the_equations(scheme, row):
    kind, h, t0 = row["kind"], 0.1 * row["sign"], 0.3
    ridges = axes.ridges_of(kind, row["ndof"], row["nnoise"], row["time"])
    model = axes.model_of(ridges, kind, third=row["third"])
    q0, p0 = axes.start(row["ndof"], PATHS)
    rows = axes.rows_of(h, STEPS, ROWS, row["nnoise"], PATHS)
    given = {"step": h, "steps": STEPS, "t0": t0, "scheme": scheme, "refine": 2}
    given |= {x: row[x] for x in ("first_step", "first_path", "correction") if x in row}
    run = ss.simulate(model, q0=q0, p0=p0, paths=PATHS, increments=rows, **given)

    x = np.concatenate([q0, p0])
    forms = {"auto": "increments"} | {x: x for x in ("mean", "none")}
    how = {"exact": row["third"], "correction": forms[row.get("correction", "auto")]}
    if scheme in {"exact_rotation", "gauss_dkdkd_rotation"}:
        how["rotation"] = axes.rotation_of(kind, row["ndof"])
    for n in range(STEPS):
        t = t0 + (row["first_step"] + n) * h
        x = reference.step(scheme, ridges, t, reference.polygon(h, rows[ROWS * n : ROWS * (n + 1)]), x, **how)
        np.testing.assert_allclose(np.concatenate([run.q[n + 1], run.p[n + 1]]), x, rtol=0, atol=2e-12)
        np.testing.assert_allclose(run.t[n], t, rtol=1e-15)
    runs = [run]
    if scheme not in NO_GENERAL:
        general = ss.simulate(model, q0=q0, p0=p0, paths=PATHS, increments=rows, general=True, **given)
        np.testing.assert_allclose([general.q, general.p], [run.q, run.p], rtol=0, atol=1e-12)
        runs.append(general)
    if scheme in TABLEAUS + GALERKIN:  # Newton's matrix is exact, and errors in it would cost solves alone
        counts = [x.report.counters for x in runs]
        assert all(x["solves"] <= (1 if kind == "quadratic" else 6) * x["path_steps"] for x in counts)
    one = ss.simulate(model, q0=q0[:, 3:4], p0=p0[:, 3:4], paths=1, increments=rows[:, :, 3:4], **given)
    np.testing.assert_array_equal([one.q[:, :, 0], one.p[:, :, 0]], [run.q[:, :, 3], run.p[:, :, 3]])


class Muted:
    """The ridges with one H_k set to zero, or with one noise left out."""

    def __init__(self, ridges, k, *, gone):
        self.ndof, self.nnoise = ridges.ndof, ridges.nnoise - gone
        self._ridges, self._k, self._gone = ridges, k, gone

    def __getattr__(self, name):
        """A function of the ridges with the arguments t, w and further ones, in which the muted H_k has weight zero."""

        def asked(t, w, *x):
            rest = w if self._gone else np.delete(w, self._k, axis=0)
            return getattr(self._ridges, name)(t, np.insert(rest, self._k, 0, axis=0), *x)

        return asked


QUIET = axes.covering(
    scheme=(*BRACKETS, "symplectic_euler", "midpoint", "averaged_shift_midpoint", "verlet_kdk_strong2"),
    kind=range(8), third=(True, False), silent=(1, 2, 3), sign=(1, -1), time=axes.AXES["time"], ndof=(1, 2),
)  # fmt: skip


@pytest.mark.parametrize("row", QUIET, ids=map(axes.ident, QUIET))
def test_a_silent_noise_is_as_none(row):
    """Any of three noises may be the silent one: steps are those of a model without it."""
    kind, h, silent = KINDS[row["scheme"]][row["kind"] % len(KINDS[row["scheme"]])], 0.1 * row["sign"], row["silent"]
    ridges = axes.ridges_of(kind, row["ndof"], 3, row["time"])
    (q0, p0), rows = axes.start(row["ndof"], 2), axes.rows_of(h, 1, ROWS, 3, 2)
    found = []
    for gone in (False, True):
        declared = () if gone else (silent,)
        model = axes.model_of(Muted(ridges, silent, gone=gone), kind, third=row["third"], silent=declared)
        dw = np.delete(rows, silent - 1, axis=1) if gone else rows
        given = {"step": h, "steps": 1, "t0": 0.3, "scheme": row["scheme"], "refine": 2, "increments": dw}
        run = ss.simulate(model, q0=q0, p0=p0, paths=2, **given)
        found.append([run.q, run.p])
    np.testing.assert_allclose(*found, rtol=0, atol=1e-13)


HUSHED = axes.covering(
    nnoise=(16, 17, 20), silent=("first", "last", "17th", "others", "even", "all"), kind=("kick", "position", "both"),
    sign=(1, -1), scheme=("midpoint", "stormer_verlet", "gauss2"),
)  # fmt: skip


@pytest.mark.parametrize("row", HUSHED, ids=map(axes.ident, HUSHED))
def test_silent_ones_of_many_noises(row):
    """Noises beyond the sixteenth are probed together: any of them may be declared silent, but none that acts."""
    m, every = row["nnoise"], range(1, row["nnoise"] + 1)
    silent = {"first": [1], "last": [m], "17th": [min(17, m)], "others": every[:-1], "even": every[1::2], "all": every}
    silent = tuple(silent[row["silent"]])
    ridges, h = axes.ridges_of(row["kind"], 1, m), 0.1 * row["sign"]
    ridges.s[np.isin(ridges.j, silent)] = 0
    (q0, p0), rows = axes.start(1, 3), axes.rows_of(h, 1, 1, m, 3)
    given = {"q0": q0, "p0": p0, "paths": 3, "step": h, "steps": 1, "scheme": row["scheme"], "increments": rows}
    one, two = (ss.simulate(axes.model_of(ridges, row["kind"], silent=x), **given) for x in (silent, ()))
    np.testing.assert_array_equal([one.q, one.p], [two.q, two.p])
    acts = [k for k in every if k not in silent]
    for k in {*acts[:1], *acts[-1:]}:
        with pytest.raises(ss.errors.FalseTraitError, match="silent"):
            ss.simulate(axes.model_of(ridges, row["kind"], silent=(*silent, k)), **given)


def own_noise():
    """Coefficients and weights of the noise that are unrelated to the coefficients of the drift."""
    a, abar, b, bbar = 0.4 * np.random.default_rng(3).uniform(-1, 1, (4, 2, 2))
    return ss.schemes.from_tableau(a, abar, [0.4, 0.6], allow_nonsymplectic=True, b=b, bbar=bbar, beta=[0.7, 0.3])


class OwnWeights(reference.OneStep):
    """The noise has weights of its own at the nodes, as shares of the drift's; the node is found by its time."""

    def __init__(self, ridges, t, drive, nodes, shares):
        """Nodes and shares are those of the quadrature."""
        super().__init__(ridges, t, drive)
        self._times, self._shares = t + drive.h * nodes, shares

    def __call__(self, t, x, w=None):
        share = self._shares[np.argmin(np.abs(self._times - t))]
        return super().__call__(t, x, self.w * np.where(np.arange(len(self.w)) == 0, 1, share)[:, None])


#: weights that sum to one: none at the first node, none in the middle, a negative one, none equal to the drift's
NOISY = {2: ([0.0, 1.0], [1.3, -0.3], [0.3, 0.7]), 3: ([0.0, 0.4, 0.6], [0.3, 0.0, 0.7], [0.6, -0.1, 0.5])}
QUADRATURES = (("gauss2", 2), ("lobatto2", 2), ("otr", 2), ("gauss3", 3), ("lobatto3", 3), ("lobatto2", 1),
               ("gauss2", 1), ("gauss3", 2), ("lobatto3", 2))  # fmt: skip
WEIGHED = axes.covering(**axes.AXES, rule=QUADRATURES, own=range(3), kind=range(3), general=(False, True))


@pytest.mark.parametrize("row", WEIGHED, ids=map(axes.ident, WEIGHED))
def test_noise_has_the_weights_that_a_quadrature_gives_it(row):
    """Tableaux if there are as many nodes as the degree, else polynomials with more nodes; also reversed."""
    name, degree = row["rule"]
    nodes, alpha = reference.rule(name)
    beta, galerkin = np.array(NOISY[len(nodes)][row["own"]]), degree < len(nodes)
    kind = ("position", "kick", "mass" if galerkin else "coupled")[row["kind"]]
    ridges = axes.ridges_of(kind, row["ndof"], row["nnoise"], row["time"])
    turned = slice(None, None, -1 if row["first_step"] else 1)
    given = [x[turned] for x in (nodes, alpha)]
    scheme = ss.schemes.from_quadrature(*given, degree, noise_weights=beta[turned])
    h, t0 = 0.1 * row["sign"], 0.3
    x, rows = axes.start(row["ndof"], PATHS), axes.rows_of(h, 1, 1, row["nnoise"], PATHS)
    how = {"step": h, "steps": 1, "t0": t0, "scheme": scheme, "paths": PATHS, "increments": rows, "correction": "none"}
    how |= {"general": row["general"], "first_step": row["first_step"], "first_path": row["first_path"]}
    run = ss.simulate(axes.model_of(ridges, kind), q0=x[0], p0=x[1], **how)
    hhat = OwnWeights(ridges, t0 + row["first_step"] * h, reference.polygon(h, rows), nodes, beta / alpha)
    if galerkin:
        end = reference.galerkin_step(hhat, degree, (nodes, alpha), np.concatenate(x))
    else:
        end = reference.tableau_step(hhat, (*reference.collocation(nodes, alpha), alpha, nodes), np.concatenate(x))
    np.testing.assert_allclose(np.concatenate([run.q[1], run.p[1]]), end, rtol=0, atol=2e-12)


REVERSED = (*ONE_SIDED, "lobatto3", "P2N2Q2Otr", "dirk:0.25", "heun", "own")
BACK = axes.covering(**axes.AXES, kind=("position", "separable", "coupled"), scheme=REVERSED)


@pytest.mark.parametrize("row", BACK, ids=map(axes.ident, BACK))
def test_the_adjoint_goes_back(row):
    """A step of the adjoint back along the same path is the inverse, also of compositions, with noise weights and
    correction.
    """
    ridges = axes.ridges_of(row["kind"], row["ndof"], row["nnoise"], row["time"])
    model, h = axes.model_of(ridges, row["kind"]), 0.1 * row["sign"]
    correction = "none" if row["scheme"] in {"heun", "own"} else "auto"
    one = own_noise() if row["scheme"] == "own" else row["scheme"]
    both = ss.schemes.composition([one, "stormer_verlet"], [0.4, 0.6]) if row["first_step"] else one
    x, dw = axes.start(row["ndof"], 3), axes.rows_of(h, 1, 1, row["nnoise"], 3)[0]
    there = ss.step(model, both, *x, h, dw, t=0.3, correction=correction)
    back = ss.step(model, ss.schemes.adjoint(both), *there, -h, -dw, t=0.3 + h, correction=correction)
    np.testing.assert_allclose(back, x, rtol=0, atol=1e-13)


PART = ("midpoint", "symplectic_euler", "lobatto3", "heun", "own")
PARTS = axes.covering(**axes.AXES, kind=("position", "coupled"), one=PART, two=PART, three=PART)


@pytest.mark.parametrize("row", PARTS, ids=map(axes.ident, PARTS))
def test_a_composition_is_its_parts(row):
    """A composition consists of steps by fractions of h, with the same fractions of dW, one after another; one fraction
    may be negative.
    """
    model = axes.model_of(axes.ridges_of(row["kind"], row["ndof"], row["nnoise"], row["time"]), row["kind"])
    parts, fractions = [own_noise() if row[x] == "own" else row[x] for x in ("one", "two", "three")], [0.7, -0.5, 0.8]
    h, dw = 0.1 * row["sign"], axes.rows_of(0.1, 1, 1, row["nnoise"], 3)[0]
    x = axes.start(row["ndof"], 3)
    whole = ss.step(model, ss.schemes.composition(parts, fractions), *x, h, dw, t=0.3, correction="none")
    t = 0.3
    for part, share in zip(parts, fractions, strict=True):
        x = ss.step(model, part, *x, share * h, share * dw, t=t, correction="none")
        t += share * h
    np.testing.assert_allclose(whole, x, rtol=0, atol=1e-13)


@pytest.mark.parametrize("off", [1e-12, -1e-12])
def test_fractions_of_a_composition_are_one_step(off):
    """Fractions must sum to one to rounding; 2e-15 is rounding."""
    assert ss.schemes.composition(["midpoint"] * 2, [0.4, 0.6 + 2e-3 * off]).info.symplectic
    with pytest.raises(ss.errors.InvalidArgumentError, match="sum to"):
        ss.schemes.composition(["midpoint"] * 2, [0.4, 0.6 + off])


SYMMETRIC = tuple(scheme for scheme in KINDS if ss.schemes.get(scheme).info.symmetric)
TRIPS = axes.covering(**axes.AXES, scheme=SYMMETRIC, kind=range(8))


@pytest.mark.parametrize("row", TRIPS, ids=map(axes.ident, TRIPS))
def test_a_symmetric_scheme_comes_back(row):
    """Two steps forward and two steps back along the same path return to the start; dZ, K, areas, J and times are
    those of the way back.
    """
    kind = KINDS[row["scheme"]][row["kind"] % len(KINDS[row["scheme"]])]
    model = axes.model_of(axes.ridges_of(kind, row["ndof"], row["nnoise"], row["time"]), kind)
    x, h = axes.start(row["ndof"], 3), 0.1 * row["sign"]
    rows = axes.rows_of(h, 2, 4, row["nnoise"], 3)
    how = {"scheme": row["scheme"], "steps": 2, "paths": 3, "refine": 2, "first_path": row["first_path"]}
    first = row["first_step"]
    there = ss.simulate(model, q0=x[0], p0=x[1], step=h, first_step=first, t0=0.3, increments=rows, **how)
    end = 0.3 + (first + 2) * h
    back = ss.simulate(model, q0=there.q[-1], p0=there.p[-1], step=-h, t0=end, increments=-rows[::-1], **how)
    np.testing.assert_allclose([back.q, back.p], [there.q[::-1], there.p[::-1]], rtol=0, atol=2e-12)


def test_what_is_not_symmetric_does_not_come_back():
    """The twin: schemes that are not symmetric do not return."""
    with pytest.raises(AssertionError):
        test_a_symmetric_scheme_comes_back({**TRIPS[0], "scheme": "heun"})


SINGULAR = axes.covering(**axes.AXES, kind=("kick", "coupled"), paths=(1, 3, 40))


@pytest.mark.parametrize("row", SINGULAR, ids=map(axes.ident, SINGULAR))
def test_a_singular_step_is_rescued(row):
    """With 1 + h^2 U''/4 = 0 at rest Newton's first matrix is singular, but the rescue finds a root of the
    equations.
    """
    n, m, paths, h = row["ndof"], row["nnoise"], row["paths"], 0.5 * row["sign"]
    q, p = np.eye(2 * n)[:n], np.eye(2 * n)[n:]
    swing = (0.5, 2.0) if row["time"] in {"noise", "both"} else (0, 0)
    found = [(0, f, s, 0, 0, x, 0) for i in range(n) for f, s, x in ((2, 0.5, p[i]), (2, -8, q[i]), (4, 0.25, q[i]))]
    found += [(0, "sin", 0.1, 0, 0, q[i] - q[i - 1], 0) for i in range(1, n)]
    found.append((0, 1, 0.3, 0.5 if row["time"] in {"H", "both"} else 0, 2.3, q.sum(axis=0), 0))
    ridges = reference.Ridges(n, m, found + [(k, 1, 0.3, *swing, q[k % n], 0) for k in range(1, m + 1)])
    dw, x = axes.rows_of(0.01, 1, 1, m, paths), np.zeros((2 * n, paths))
    given = {"step": h, "steps": 1, "t0": 0.3, "first_step": row["first_step"], "first_path": row["first_path"]}
    run = ss.simulate(axes.model_of(ridges, row["kind"]), q0=x[:n], p0=0.0, paths=paths, increments=dw, **given)
    assert not run.status.any() and run.report.counters["damped"] + run.report.counters["continued"] > 0
    end = np.concatenate([run.q[1], run.p[1]])
    t = 0.3 + (row["first_step"] + 0.5) * h
    force = reference.OneStep(ridges, t, reference.polygon(h, dw))(t, (x + end) / 2)
    np.testing.assert_allclose(end, x + ridges.turn @ force, rtol=0, atol=1e-12)
