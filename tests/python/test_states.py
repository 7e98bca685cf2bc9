# SPDX-License-Identifier: BSD-3-Clause
"""Initial states drawn from laws: the documented counter, exact covariances, the same bits in every part of a run."""

import json
import math
import pickle
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import symsde as ss
from symsde.cli import command_line
from symsde.errors import IncompatibleError, InvalidArgumentError, NumericalError, WrongShapeError, WrongTypeError

RUN = {"step": 0.05, "steps": 20, "save_every": 10}
SEED = 2**63 + 5


def philox(counter, key):
    """Philox4x32-10 of one counter and key, as published."""
    c, k = list(counter), list(key)
    for _ in range(10):
        a, b = 0xD2511F53 * c[0], 0xCD9E8D57 * c[2]
        c = [(b >> 32) ^ c[1] ^ k[0], b & 0xFFFFFFFF, (a >> 32) ^ c[3] ^ k[1], a & 0xFFFFFFFF]
        k = [(k[0] + 0x9E3779B9) & 0xFFFFFFFF, (k[1] + 0xBB67AE85) & 0xFFFFFFFF]
    return c


def words(seed, path, i, purpose, stream=0):
    """The words of the states of degree of freedom i of a path, by the documented counter."""
    return philox(
        (path & 0xFFFFFFFF, path >> 32, 0, i + (stream << 20) + (purpose << 26)), (seed & 0xFFFFFFFF, seed >> 32)
    )


def normals(seed, path, i):
    """The normals of q_i and p_i of a path, by Box and Muller as documented."""
    first, second, *_ = words(seed, path, i, 11)
    r = math.sqrt(-2 * math.log((first + 0.5) / 2**32))
    turn = 2 * math.pi * ((second // 2 % 2**30) + 0.5) / 2**32
    signs = (-1 if second >> 31 & 1 else 1, -1 if second & 1 else 1)
    return signs[0] * r * math.cos(turn), signs[1] * r * math.sin(turn)


def uniforms(seed, path, i, stream=0):
    """The uniforms of q_i and p_i of a path, in (0, 1)."""
    w = words(seed, path, i, 12, stream)
    return tuple((((w[j] << 20) | (w[j + 1] >> 12)) + 0.5) / 2**52 for j in (0, 2))


def coupled(tilt=0.3):
    """Two oscillators that meet in q and, by a rotation, in q and p."""
    return ss.model_from_sympy(
        f"(p1**2 + p2**2)/2 + q1**2 + 2*q2**2 + {tilt}*q1*q2 + 0.2*(q1*p2 - q2*p1)", noise=["0.1*q1", "0.1*q2"]
    )


def test_numbers_of_the_counter():
    """Draws normals and uniforms by (seed, path, degree of freedom): each is that of its counter."""
    model, first = ss.models.henon_heiles(), 2**40 + 77
    q, p = ss.states.normal([1.0, -2.0], sd=[0.5, 2.0]).draw(model, 300, seed=SEED, first_path=first)
    u, v = ss.states.uniform(-1.0, 3.0).draw(model, 300, seed=SEED, first_path=first)
    for path in (0, 1, 255, 299):
        for i in range(2):
            z = normals(SEED, first + path, i)
            expected = [(1.0, -2.0)[i] + (0.5, 2.0)[i] * x for x in z]
            np.testing.assert_allclose((q[i, path], p[i, path]), expected, rtol=0, atol=1e-12)
            x = uniforms(SEED, first + path, i)
            np.testing.assert_allclose((u[i, path], v[i, path]), [-1 + 4 * y for y in x], rtol=0, atol=1e-14)
    one, _ = ss.states.normal(1.0, 0.5).draw(ss.models.kubo(), 300, seed=SEED, first_path=first)
    assert np.array_equal(one[0], q[0])  # whatever degrees of freedom are beside it


def test_runs_begin_there():
    """Begins runs at the drawn states, and drives them by the same noise as arrays of these states."""
    model, law = ss.models.kubo(), ss.states.normal(0.5, 0.2)
    run = ss.simulate(model, q0=law, p0=law, paths=300, first_path=256, seed=7, **RUN)
    q, p = law.draw(model, 300, seed=7, first_path=256)
    assert np.array_equal(run.q[0], q) and np.array_equal(run.p[0], p)
    same = ss.simulate(model, q0=q, p0=p, paths=300, first_path=256, seed=7, **RUN)
    assert np.array_equal(run.q, same.q) and np.array_equal(run.p, same.p)
    half = ss.simulate(model, q0=law, p0=1.0, paths=300, first_path=256, seed=7, **RUN)
    assert np.array_equal(half.q[0], q) and (half.p[0] == 1.0).all()
    own = ss.states.normal(0.5, 0.2, seed=3)
    other = ss.simulate(model, q0=own, p0=own, paths=300, first_path=256, seed=7, **RUN)
    q, p = own.draw(model, 300, seed=8, first_path=256)
    assert np.array_equal(other.q[0], q) and not np.array_equal(q, run.q[0])
    drift = ss.simulate(model, q0=q, p0=p, paths=300, first_path=256, seed=7, **RUN)
    assert np.array_equal(other.q, drift.q)  # a seed of the law changes no noise


@pytest.mark.parametrize("options", [{"threads": 1, "lanes": 8}, {"threads": 2, "lanes": 64}], ids=["one", "two"])
def test_parts_have_the_same_bits(options):
    """Draws the same states for any threads, lanes, parts of the paths, and shards of an ensemble."""
    model, law = coupled(), ss.states.normal(cov=np.diag([1.0, 2.0, 3.0, 4.0]) + 0.5)
    given = {"q0": law, "p0": law, "seed": 11, "scheme": "midpoint", **RUN}
    whole = ss.simulate(model, paths=700, **given)
    part = ss.simulate(model, paths=100, first_path=300, **given, **options)
    assert np.array_equal(part.q, whole.q[..., 300:400]) and np.array_equal(part.p, whole.p[..., 300:400])
    means = ss.moments(model, paths=700, **given, **options)
    np.testing.assert_allclose(means.mean_q, whole.q.mean(2), rtol=1e-12, atol=1e-14)
    with ThreadPoolExecutor(2) as executor:
        shards = ss.ensemble(model, paths=700, shard_paths=256, executor=executor, **given)
    assert np.array_equal(shards.mean_q, means.mean_q) and np.array_equal(shards.var_p, means.var_p)


def test_exact_covariance():
    """Combines numbers by a factor whose square is the covariance, also a singular one."""
    model = coupled()
    for cov in (np.diag([1.0, 2.0, 3.0, 4.0]) + 0.5, np.outer([1.0, 2.0, -1.0, 0.5], [1.0, 2.0, -1.0, 0.5])):
        law = ss.states.normal(cov=cov)
        z = np.stack([np.ravel(normals(5, path, i), order="F") for i in (0, 1) for path in range(4)])
        z = z.reshape(2, 4, 2).transpose(2, 0, 1).reshape(4, 4)  # (number, path)
        x = np.concatenate(law.draw(model, 4, seed=5))
        factor = x @ np.linalg.inv(z)
        np.testing.assert_allclose(factor @ factor.T, cov, rtol=0, atol=1e-9)


def test_matched_by_twiss_parameters():
    """Draws the ellipse of emittance, beta and alpha, about a centre."""
    law = ss.states.matched([0.02, 0.05], beta=[2.0, 0.5], alpha=[0.7, -0.3])
    cov = law.covariance(coupled())
    for i, (e, b, a) in enumerate(zip((0.02, 0.05), (2.0, 0.5), (0.7, -0.3), strict=True)):
        block = cov[np.ix_((i, 2 + i), (i, 2 + i))]
        np.testing.assert_allclose(block, e * np.array([[b, -a], [-a, (1 + a**2) / b]]), rtol=1e-14)
        assert abs(np.linalg.det(block) - e**2) < 1e-15
    z = np.array(normals(4, 9, 0))
    q, p = ss.states.matched(0.02, beta=2.0, alpha=0.7, q=0.3, p=-0.1).draw(ss.models.kubo(), 1, seed=4, first_path=9)
    size = math.sqrt(0.02)
    np.testing.assert_allclose(q[0, 0], 0.3 + size * math.sqrt(2.0) * z[0], rtol=1e-13)
    np.testing.assert_allclose(p[0, 0], -0.1 + size * (z[1] - 0.7 * z[0]) / math.sqrt(2.0), rtol=1e-13)


def test_matched_to_the_flow_and_to_a_map():
    """Finds the ellipse that the linearised flow, or a step, maps onto itself, in planes alone and coupled."""
    ring = ss.models.synchrotron(omega=2.0, sigma1=0.3, sigma2=0.0)
    np.testing.assert_allclose(ss.states.matched(0.01).covariance(ring), np.diag([0.005, 0.02]), rtol=1e-13)
    h = 0.5  # leapfrog with half kicks: cos mu = 1 - (omega h)^2/2, beta = h/sin mu
    sine = math.sqrt(1 - (1 - 2 * h**2) ** 2)
    cov = ss.states.matched(0.01, step=h, scheme="stormer_verlet").covariance(ring)
    np.testing.assert_allclose(cov[0, 0], 0.01 * h / sine, rtol=1e-12)
    np.testing.assert_allclose(np.linalg.det(cov), 1e-4, rtol=1e-12)
    assert abs(cov[0, 1]) < 1e-15
    model = coupled()
    qq, qp, pp = (x[..., 0] for x in model.hessian(0.0, 0.0))
    a = np.block([[qp, pp], [-qq, -qp.T]])
    cov = ss.states.matched([0.02, 0.05]).covariance(model)
    np.testing.assert_allclose(a @ cov + cov @ a.T, 0, atol=1e-14)
    j = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.eye(2), np.zeros((2, 2))]])
    emittances = np.sort(np.abs(np.linalg.eigvals(j @ cov).imag))[::2]
    np.testing.assert_allclose(emittances, [0.02, 0.05], rtol=1e-11)
    assert cov[0, 0] < cov[1, 1]  # the small emittance belongs to the first plane
    m = ss.tangent(model, q0=0.0, p0=0.0, step=0.4, steps=1, increments=np.zeros((1, 2))).matrix[..., 0]
    cov = ss.states.matched([0.02, 0.05], step=0.4).covariance(model)
    np.testing.assert_allclose(m @ cov @ m.T, cov, atol=1e-14)
    twin = 1.01 * ss.states.matched([0.02, 0.05]).covariance(model)[0, 0]
    assert abs(twin - cov[0, 0]) > 1e-6


def test_canonical():
    """Draws p with the masses and q of a quadratic potential about its minimum; refuses what is no normal law."""
    beta, bath = 2.0, ss.states.canonical(2.0)
    model = ss.model_from_sympy("p1**2/(2*m) + p2**2/2 + q1**2 + q1*q2 + 2*q2**2 + q1", params={"m": 3.0})
    stiff = np.array([[2.0, 1.0], [1.0, 4.0]])
    z = np.array([normals(1, path, i) for i in (0, 1) for path in range(4)]).reshape(2, 4, 2)
    q, p = bath.draw(model, 4, seed=1)
    np.testing.assert_allclose(p, z[..., 1] * np.sqrt(np.array([[3.0], [1.0]]) / beta), rtol=1e-12)
    rest = -np.linalg.solve(stiff, [1.0, 0.0])
    factor = np.linalg.cholesky(np.linalg.inv(stiff) / beta)
    np.testing.assert_allclose(q, rest[:, None] + factor @ z[..., 0], rtol=1e-11)
    pendulum = ss.models.pendulum()
    run = ss.simulate(pendulum, q0=0.5, p0=bath, paths=3, seed=1, **RUN)
    np.testing.assert_allclose(run.p[0, 0], [normals(1, k, 0)[1] / math.sqrt(2.0) for k in range(3)], rtol=1e-12)
    for given, word in (
        (pendulum, "potential"),
        (coupled(), "terms with both"),
        (ss.model_from_sympy("p**2/2 + p**4 + q**2"), "kinetic energy"),
        (ss.model_from_sympy("p**2/2 - q**2"), "does not grow"),
    ):
        with pytest.raises(IncompatibleError, match=word):
            ss.simulate(given, q0=bath, p0=bath, paths=3, **RUN)
    many = ss.models.kubo().with_parameters(a=np.array([1.0, 2.0, 3.0]))
    with pytest.raises(IncompatibleError, match="from path to path"):
        ss.simulate(many, q0=bath, p0=bath, paths=3, **RUN)


def test_units_of_their_own():
    """Judges every number beside those of its own coordinate, however large the others are."""
    model = ss.models.kubo()
    q, p = ss.states.normal(cov=[[1e-12, 6e-5], [6e-5, 1e4]]).draw(model, 5, seed=SEED)
    z = np.array([normals(SEED, path, 0) for path in range(5)]).T
    np.testing.assert_allclose(q[0], 1e-6 * z[0], rtol=1e-12)
    np.testing.assert_allclose(p[0], 60 * z[0] + 80 * z[1], rtol=1e-12)
    with pytest.raises(InvalidArgumentError, match="not symmetric"):
        ss.states.normal(cov=[[1e-12, 6e-5], [7e-5, 1e4]])
    with pytest.raises(InvalidArgumentError, match="negative eigenvalue"):
        ss.states.normal(cov=[[1e-12, 1.01e-4], [1.01e-4, 1e4]])
    stiff, bath = "p1**2/2 + p2**2/2 + k*q1**2/2 + q2**2/2", ss.states.canonical(2.0)
    q, p = bath.draw(ss.model_from_sympy(stiff, params={"k": 1e12}), 5, seed=SEED)
    np.testing.assert_allclose(1e6 * q[0], p[0] * z[0] / z[1], rtol=1e-12)
    for more, word in ((" + q2**4/2000", "potential"), (" + q2*p2/20", "terms with both")):
        with pytest.raises(IncompatibleError, match=word):
            bath.draw(ss.model_from_sympy(stiff + more, params={"k": 1e8}), 5)
    soft = ss.model_from_sympy("p**2/2 + k*(q - 10)**2/2", params={"k": 1e-12})
    with pytest.raises(InvalidArgumentError, match="do not vanish"):
        ss.states.matched(0.1).draw(soft, 5)
    np.testing.assert_allclose(ss.states.matched(0.1, q=10.0).covariance(soft), np.diag([1e5, 1e-7]), rtol=1e-12)
    assert np.isfinite(ss.states.uniform(-1e308, 1e308).draw(model, 5)).all()


def test_formulas_of_variables():
    """Computes states from drawn variables: each variable is that of its counter, of a stream of its own."""
    law = ss.states.formula(
        {"a": ss.states.uniform(0.0, 0.5), "b": ss.states.normal(1.0, 2.0), "c": 3.0, "d": ss.states.uniform(1.0, 2.0)},
        q="sqrt(2*a)*cos(b)",
        p="c*d",
    )
    q, p = law.draw(ss.models.kubo(), 300, seed=SEED, first_path=5)
    for path in (0, 299):
        a, d = uniforms(SEED, 5 + path, 0, 1)[0] / 2, 1 + uniforms(SEED, 5 + path, 1, 1)[1]
        w = words(SEED, 5 + path, 0, 11, 1)
        r = math.sqrt(-2 * math.log((w[0] + 0.5) / 2**32))
        turn = 2 * math.pi * ((w[1] // 2 % 2**30) + 0.5) / 2**32
        b = 1 + 2 * r * math.sin(turn) * (-1 if w[1] & 1 else 1)
        np.testing.assert_allclose((q[0, path], p[0, path]), (math.sqrt(2 * a) * math.cos(b), 3 * d), rtol=1e-12)
    part, _ = law.draw(ss.models.kubo(), 7, seed=SEED, first_path=105)
    assert np.array_equal(part[0], q[0, 100:107])
    for given, word in (
        ({"q": "a + q1"}, "formulas of the variables"),
        ({"q": "a + z"}, "z"),
        ({"q": ["a", "b"]}, "one for each"),
        ({"p": "a"}, "no formulas of q"),
        ({"q": "log(a - 1)"}, "not finite"),
    ):
        bad = {"variables": {"a": ss.states.uniform(0.0, 0.5), "b": 1.0}} | given
        with pytest.raises((InvalidArgumentError, WrongShapeError, WrongTypeError), match=word):
            ss.simulate(ss.models.kubo(), q0=ss.states.formula(**bad), p0=0.0, paths=5, **RUN)


def test_tables(tmp_path):
    """Takes row i for path i, by names of columns, or rows drawn by a uniform number of a stream of its own."""
    rows = np.arange(40.0).reshape(20, 2)
    file = tmp_path / "bunch.csv"
    file.write_text("# made by hand\np,weight,q\n" + "".join(f"{p},1,{q}\n" for q, p in rows))
    np.save(tmp_path / "bunch.npy", rows)
    model = ss.models.kubo()
    for given in (rows, file, tmp_path / "bunch.npy"):
        law = ss.states.table(given)
        run = ss.simulate(model, q0=law, p0=law, paths=5, first_path=3, **RUN)
        assert np.array_equal(run.q[0, 0], rows[3:8, 0]) and np.array_equal(run.p[0, 0], rows[3:8, 1])
    with pytest.raises(IncompatibleError, match="20 rows"):
        ss.simulate(model, q0=law, p0=law, paths=5, first_path=16, **RUN)
    law = ss.states.table(rows, drawn=True)
    q, p = law.draw(model, 50, seed=9, first_path=100)
    chosen = [int(uniforms(9, 100 + k, 0, 2)[0] * 20) for k in range(50)]
    assert np.array_equal(q[0], rows[chosen, 0]) and np.array_equal(p[0], rows[chosen, 1])
    rows[:] = 0
    assert law.draw(model, 50, seed=9, first_path=100)[0].any()  # the table was copied
    (tmp_path / "no.csv").write_text("q,p\n1,x\n")
    (tmp_path / "ragged.csv").write_text("1,2\n3\n")
    for name in ("no.csv", "ragged.csv", "absent.csv", "bunch.txt", "."):
        with pytest.raises((InvalidArgumentError, WrongShapeError)):
            ss.states.table(tmp_path / name)


def test_answers():
    """Takes means over the states: rotations leave a round normal law as it is, E q^2 = sd^2 at all times.

    The interval is missed by 5 standard errors with a chance below 1e-6; a fault of 1 % is 6 standard errors.
    """
    model, law = ss.models.kubo(a=1.0, sigma=0.3), ss.states.normal(0.0, 0.8)
    for found in (
        ss.expect(model, "q**2", q0=law, p0=law, horizon=2.0, abs=0.002, seed=3),
        ss.mlmc(model, "q**2", q0=law, p0=law, horizon=2.0, abs=0.002, seed=3),
    ):
        assert abs(found.value - 0.64) < 5 / 1.96 * 0.002 < 0.01
    same = ss.expect(model, "q**2", q0=0.0, p0=0.0, horizon=2.0, abs=0.002, seed=3)
    assert same.value == 0.0
    with pytest.raises(NumericalError, match="one initial state"):
        ss.expect(model, "q**2", q0=law, p0=law, horizon=2.0, abs=0.01, method="antithetic")


def test_other_doors():
    """Draws states in gradients, tangents, prepared runs, sweeps, and studies as in runs."""
    model, law = ss.models.kubo(), ss.states.normal(0.5, 0.2)
    q, p = law.draw(model, 60, seed=7)
    run = {"step": 0.05, "steps": 20, "paths": 60, "seed": 7}
    drawn, given = (ss.gradient(model, "q**2", ["sigma", "q0"], q0=x, p0=y, **run) for x, y in ((law, law), (q, p)))
    assert drawn.values["sigma"] == given.values["sigma"] and np.array_equal(drawn.values["q0"], given.values["q0"])
    assert np.array_equal(ss.tangent(model, q0=law, p0=law, **run).q, ss.tangent(model, q0=q, p0=p, **run).q)
    prepared = ss.prepare(model, "midpoint", step=0.05, q0=law, p0=0.0, paths=60, seed=7)
    assert np.array_equal(prepared.run(1).q[0], q)
    prepared.reset(seed=8)
    assert np.array_equal(prepared.run(1).q[0], law.draw(model, 60, seed=8)[0])
    found = ss.sweep(model, {"sigma": [0.1, 0.2]}, q0=law, p0=law, keep_paths=True, **(run | {"paths": 30}))
    assert np.array_equal(found.q[0, :, 0], q[:, :30]) and np.array_equal(found.q[0, :, 1], q[:, 30:])
    same = ss.sweep(
        model, {"sigma": [0.1, 0.2]}, q0=law, p0=law, keep_paths=True, same_noise=True, **(run | {"paths": 30})
    )
    assert np.array_equal(same.q[0, :, 0], q[:, :30]) and np.array_equal(same.q[0, :, 1], q[:, :30])
    study = {"steps": [8, 16, 32], "horizon": 1.0, "paths": 60, "seed": 7}
    one, other = (ss.convergence(model, q0=x, p0=y, **study) for x, y in ((law, law), (q, p)))
    assert np.array_equal(one.error, other.error)


def test_told_and_kept():
    """Tells laws in files, and draws the same states after a pickle."""
    model, law = ss.models.kubo(), ss.states.normal(0.5, 0.2, seed=4)
    run = ss.simulate(model, q0=law, p0=law, paths=9, seed=7, **RUN)
    assert json.loads(run.attributes()["q0"]) == {"law": "normal", "mean": 0.5, "sd": 0.2, "seed": 4}
    again = pickle.loads(pickle.dumps(run))
    assert np.array_equal(again.setup.q0, run.q[0]) and np.array_equal(again.extend(10).q, run.extend(10).q)
    assert "normal(mean=0.5, sd=0.2, seed=4)" in repr(law)


SCENE = """
[model]
name = "kubo"
[run]
step = 0.05
steps = 20
save_every = 10
paths = 700
seed = 3
{start}
[output]
paths = [0, 500]
"""


@pytest.mark.parametrize(
    ("start", "law"),
    [
        ('initial = {law = "normal", mean = 0.5, sd = 0.2, seed = 5}', lambda: ss.states.normal(0.5, 0.2, seed=5)),
        ('initial = {law = "canonical", beta = 2}', lambda: ss.states.canonical(2.0)),
        ('initial = {law = "matched", emittance = 0.1, step = 0.05}', lambda: ss.states.matched(0.1, step=0.05)),
        ('initial = {law = "table", rows = "bunch.csv", drawn = true}', None),
        (
            'initial = {law = "formula", variables = {a = {law = "uniform", low = 0, high = 1}}, q = "a", p = "-a"}',
            lambda: ss.states.formula({"a": ss.states.uniform(0, 1)}, q="a", p="-a"),
        ),
    ],
    ids=["normal", "canonical", "matched", "table", "formula"],
)
def test_scenes(start, law, tmp_path, monkeypatch):
    """Draws the states of scenes: shards in two parts merge to the bits of one run, and a folder opens by itself."""
    monkeypatch.chdir(tmp_path)
    cli = command_line.main
    rows = np.linspace(-1.0, 1.0, 60).reshape(30, 2)
    np.savetxt(tmp_path / "bunch.csv", rows, delimiter=",", header="q,p", comments="")
    law = ss.states.table(rows, drawn=True) if law is None else law()
    (tmp_path / "scene.toml").write_text(SCENE.format(start=start))
    for part in (1, 2):
        run = ["run", "scene.toml", "--shard", f"{part}/2", "--shard-paths", "256", "--out", f"part-{part}", "--quiet"]
        assert cli(run) == 0
    assert cli(["merge", "part-1", "part-2", "--out", "whole", "--quiet"]) == 0
    given = {"q0": law, "p0": law, "paths": 700, "seed": 3, **RUN}
    found = ss.open_run(tmp_path / "whole")
    assert np.array_equal(found.moments.mean_q, ss.moments(ss.models.kubo(), **given).mean_q)
    assert np.array_equal(found.run.q, ss.simulate(ss.models.kubo(), **given).q[..., [0, 500]])
    assert cli(["run", "scene.toml", "--out", "whole", "--quiet"]) == 0
    (tmp_path / "scene.toml").write_text(SCENE.format(start='initial = {law = "normal", mean = 0.5, sd = 0.201}'))
    assert cli(["run", "scene.toml", "--out", "whole", "--quiet"]) == 2


@pytest.mark.parametrize(
    ("start", "word"),
    [
        ("initial = 3", "give a law"),
        ('initial = {law = "norml", sd = 1}', "norml"),
        ("initial = {sd = 1}", "lacks law"),
        ('initial = {law = "normal", s = 1}', "'s' is no key"),
        ('initial = {law = "uniform", low = 1}', "lacks high"),
        ('initial = {law = "table", rows = "absent.csv"}', "absent.csv"),
        ('initial = {law = "normal", sd = 1}\nq0 = 1', "leave one out"),
        ('q0 = {law = "normal", sd = -1}\np0 = 0', "negative"),
    ],
)
def test_bad_scenes(start, word, tmp_path, monkeypatch, capfd):
    """Refuses scenes with a sentence."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.toml").write_text(SCENE.format(start=start))
    assert command_line.main(["check", "scene.toml"]) == 2
    assert word in capfd.readouterr().err


@pytest.mark.parametrize(
    ("make", "kind"),
    [
        (lambda: ss.states.normal(0.0), WrongTypeError),
        (lambda: ss.states.normal(0.0, 1.0, cov=[[1.0]]), WrongTypeError),
        (lambda: ss.states.normal(cov=[[1.0, 2.0], [2.0, 1.0]]), InvalidArgumentError),
        (lambda: ss.states.normal(cov=[[1.0, 2.0], [0.0, 1.0]]), InvalidArgumentError),
        (lambda: ss.states.normal(cov=[1.0, 2.0]), WrongShapeError),
        (lambda: ss.states.normal(math.nan, 1.0), InvalidArgumentError),
        (lambda: ss.states.normal(0.0, 1.0, seed=-1), InvalidArgumentError),
        (lambda: ss.states.uniform(1.0, 0.0), InvalidArgumentError),
        (lambda: ss.states.matched(-1.0), InvalidArgumentError),
        (lambda: ss.states.matched(1.0, alpha=1.0), WrongTypeError),
        (lambda: ss.states.matched(1.0, beta=1.0, step=0.1), WrongTypeError),
        (lambda: ss.states.matched(1.0, beta=0.0), InvalidArgumentError),
        (lambda: ss.states.matched(1.0, scheme="midpoint"), WrongTypeError),
        (lambda: ss.states.canonical(0.0), InvalidArgumentError),
        (lambda: ss.states.formula({}, q="1"), InvalidArgumentError),
        (lambda: ss.states.formula({"a": ss.states.normal([0.0, 1.0], 1.0)}, q="a"), WrongTypeError),
        (lambda: ss.states.formula({"a": ss.states.canonical(1.0)}, q="a"), WrongTypeError),
        (lambda: ss.states.table([[1.0, math.inf]]), InvalidArgumentError),
        (lambda: ss.states.table([[1.0, 2.0]], seed=1), InvalidArgumentError),
    ],
)
def test_bad_laws(make, kind):
    """Refuses laws that cannot be."""
    with pytest.raises(kind):
        make()


@pytest.mark.parametrize(
    ("law", "kind"),
    [
        (lambda: ss.states.normal([0.0, 0.0, 0.0], 1.0), WrongShapeError),
        (lambda: ss.states.normal(cov=np.eye(3)), WrongShapeError),
        (lambda: ss.states.matched([1.0, 1.0]), WrongShapeError),
        (lambda: ss.states.matched(1.0, q=1.0), InvalidArgumentError),
        (lambda: ss.states.matched(1.0, q=math.pi), IncompatibleError),
        (lambda: ss.states.matched(1.0, step=3.0, scheme="stormer_verlet"), IncompatibleError),
        (lambda: ss.states.table([[1.0, 2.0, 3.0]]), WrongShapeError),
    ],
)
def test_laws_that_do_not_fit(law, kind):
    """Refuses laws that do not fit the model."""
    with pytest.raises(kind):
        ss.simulate(ss.models.pendulum(), q0=law(), p0=law(), **RUN)
