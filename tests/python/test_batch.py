# SPDX-License-Identifier: BSD-3-Clause
"""Runs as folders of shards: the bits of one run for any division; resumed, shared, merged; refusals."""

import hashlib
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import symsde as ss
from conftest import moments_of, paths_of, table_of, told
from sent_at import PLACED, words
from symsde.batch import dispatch, scene, shard_file, stop
from symsde.batch.tree import Node, Tree
from symsde.cli import command_line
from symsde.errors import InvalidArgumentError

SCENE = """
[model]
name = "henon_heiles"
sigma1 = 0.2
[run]
scheme = "midpoint"
step = 0.05
steps = 120
paths = 3000
first_path = 768
seed = 9
q0 = [0.45, 0.4]
p0 = [0.1, 0.0]
save_every = 40
[output]
paths = [770, 771, 1023, 1024, 3000]
"""  # some of these paths escape and fail


@pytest.fixture(scope="module")
def known(tmp_path_factory):
    """Moments and paths of one run of the library, in the form of the command line's files."""
    folder = tmp_path_factory.mktemp("known")
    loaded = scene.load(write(folder / "scene.toml"))
    with pytest.warns(ss.PathsFailedWarning):
        moments = moments_of(loaded)
    assert 0 < moments.report.failed < 3000
    moments.save(folder / "moments.csv")
    return table_of(folder / "moments.csv"), paths_of(loaded)


def write(path, *changes, text=SCENE):
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path.write_text(text)
    return path


@pytest.fixture
def file(tmp_path):
    return str(write(tmp_path / "scene.toml"))


def run(*arguments):
    return command_line.main(["run", *map(str, arguments), "--quiet"])


def command(*arguments, **options):
    """The command line in a process of its own."""
    given = [sys.executable, "-m", "symsde", *map(str, arguments)]
    return subprocess.Popen(given, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True, **options)


def digest(folder):
    """A digest of all shards and of the table of moments."""
    total = hashlib.sha256()
    for path in sorted((Path(folder) / "shards").iterdir()):
        total.update(path.name.encode() + path.read_bytes())
    total.update("\n".join(table_of(Path(folder) / "moments.csv")).encode())
    return total.hexdigest()


def is_known(folder, known):
    """Whether a folder holds, bit for bit, the results of one call of the library."""
    assert table_of(folder / "moments.csv") == known[0]
    data = pytest.importorskip("xarray").open_dataset(folder / "run.nc")
    for name in ("q", "p", "status", "path"):
        np.testing.assert_array_equal(data[name], getattr(known[1], name), err_msg=name)
    data.close()


@pytest.mark.parametrize("size", [256, 512, 2048, 4096])
@pytest.mark.parametrize("threads", [1, 3])
def test_any_division_has_the_bits_of_one_run(size, threads, known, tmp_path):
    file = write(tmp_path / "scene.toml", ("seed = 9", f"seed = 9\nthreads = {threads}"))
    assert run(file, "--out", tmp_path / "out", "--shard-paths", size) == command_line.PATHS_FAILED
    count = sum(path.name.startswith("moments") for path in (tmp_path / "out" / "shards").iterdir())
    assert count == -(-3768 // size) - 768 // size
    is_known(tmp_path / "out", known)


def node(found):
    return Node(found.n_ok.copy(), found.to_arrays()[0].copy(), found.m2.copy())


@pytest.fixture(scope="module")
def parts():
    """Moments of 2000 paths, and of their eight units; all paths of two units fail, and the last unit is shorter."""
    model = ss.models.henon_heiles(sigma1=0.2)
    q0 = np.full((2, 2000), 0.4)
    q0[:, 256:768] = 30.0
    options = {"p0": 0.0, "step": 0.1, "steps": 30, "save_every": 10, "seed": 3, "scheme": "stormer_verlet"}
    with pytest.warns(ss.PathsFailedWarning):
        whole = ss.moments(model, q0=q0, paths=2000, **options)
        found = [
            ss.moments(model, q0=q0[:, i : i + 256], first_path=i, paths=min(256, 2000 - i), **options)
            for i in range(0, 2000, 256)
        ]
    assert found[1].n_ok[-1] == found[2].n_ok[-1] == 0 and np.isnan(found[1].mean_q[-1]).all()
    return whole, found


def test_parts_merge_in_any_order_to_the_bits_of_the_whole(parts):
    whole, found = parts
    for order in (range(8), range(7, -1, -1), [3, 0, 7, 5, 1, 2, 6, 4]):
        tree = Tree()
        for i in order:
            tree.insert(8, i, node(found[i]))
        root = tree.root()
        merged = ss.Moments(whole.setup, ())
        merged.fill_from_sums(root.n_ok, root.mean, root.m2)
        for name in ("n_ok", "mean_q", "mean_p", "mean_energy", "var_q", "var_energy", "se_mean_p", "m2"):
            np.testing.assert_array_equal(getattr(merged, name), getattr(whole, name), err_msg=name)


def test_parts_that_are_added_up_in_a_row_have_other_bits(parts):
    """The twin: moments summed in a row are right to rounding, but have other bits."""
    whole, found = parts
    tree, row = Tree(), node(found[0])
    for part in found[1:]:
        tree.insert(0, 0, row)
        tree.insert(0, 1, node(part))
        row = tree.root()
    np.testing.assert_allclose(row.mean, whole.to_arrays()[0], rtol=1e-10, atol=1e-13)
    assert (row.mean != whole.to_arrays()[0]).any()


def test_a_second_run_computes_nothing(known, file, tmp_path, monkeypatch):
    assert run(file, "--out", tmp_path / "out", "--shard-paths", 512) == command_line.PATHS_FAILED
    before = digest(tmp_path / "out")
    monkeypatch.setattr("symsde.batch.dispatch.compute", lambda *_: pytest.fail("computed again"))
    assert run(file, "--out", tmp_path / "out") == command_line.PATHS_FAILED
    assert digest(tmp_path / "out") == before


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("step = 0.05", "step = 0.04"), "run.step = 0.05 there, 0.04 here"),
        (("seed = 9", "seed = 10"), "seed = 9 there, 10 here"),
        (("sigma1 = 0.2", "sigma1 = 0.2\nalpha = 0.5"), "model.alpha = nothing there, 0.5 here"),
        (("3000]", "3001]"), "output.paths"),
        (("[output]", "[output]\nmoments = false"), "output.moments = True there, False here"),
    ],
)
def test_another_scene_in_the_same_folder_is_refused(change, said, file, tmp_path, capsys):
    assert run(file, "--out", tmp_path / "out", "--shard-paths", 1024) == command_line.PATHS_FAILED
    before = digest(tmp_path / "out")
    capsys.readouterr()
    other = write(tmp_path / "other.toml", change)
    assert run(other, "--out", tmp_path / "out") == command_line.BAD_INPUT
    shown = capsys.readouterr().err
    assert "holds another run" in shown and said in shown and "--out" in shown
    assert digest(tmp_path / "out") == before
    same = write(tmp_path / "same.toml", ("steps = 120", "steps = 120\nthreads = 2\nlanes = 64\nt0 = 0.0"))
    assert run(same, "--out", tmp_path / "out") == command_line.PATHS_FAILED


def test_results_of_an_unknown_run_are_not_overwritten(file, tmp_path, capsys):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "moments.csv").write_text("mine\n")
    assert run(file, "--out", tmp_path / "out") == command_line.BAD_INPUT
    assert "holds moments.csv but no manifest.json" in capsys.readouterr().err
    assert (tmp_path / "out" / "moments.csv").read_text() == "mine\n"


def test_another_version_is_refused(file, tmp_path, capsys):
    assert run(file, "--out", tmp_path / "out") == command_line.PATHS_FAILED
    manifest = tmp_path / "out" / "manifest.json"
    manifest.write_text(manifest.read_text().replace(f'"version": "{ss.__version__}"', '"version": "0.0.1"'))
    assert run(file, "--out", tmp_path / "out") == command_line.BAD_INPUT
    assert f"version = '0.0.1' there, '{ss.__version__}' here" in capsys.readouterr().err
    manifest.write_text("{")
    assert run(file, "--out", tmp_path / "out") == command_line.BAD_INPUT
    assert "is no manifest of a run" in capsys.readouterr().err


def test_parts_on_their_own_merge_to_the_same_bits(known, file, tmp_path):
    assert run(file, "--out", tmp_path / "whole", "--shard-paths", 256) == command_line.PATHS_FAILED
    parts = [tmp_path / f"part{i}" for i in range(1, 8)]
    for i, part in enumerate(parts, 1):
        assert run(file, "--out", part, "--shard-paths", 256, "--shard", f"{i}/7") in (
            command_line.OK,
            command_line.PATHS_FAILED,
        )
        assert not (part / "moments.csv").exists()
    assert (
        command_line.main(["merge", *map(str, parts[::-1]), "--out", str(tmp_path / "out")])
        == command_line.PATHS_FAILED
    )
    assert digest(tmp_path / "out") == digest(tmp_path / "whole")
    is_known(tmp_path / "out", known)


def test_parts_in_one_folder_end_with_the_whole(known, file, tmp_path):
    for i in (3, 1, 2):
        run(file, "--out", tmp_path / "out", "--shard-paths", 256, "--shard", f"{i}/3")
    is_known(tmp_path / "out", known)


def test_a_part_that_is_missing_is_named(file, tmp_path, capsys):
    for i in (1, 3):
        run(file, "--out", tmp_path / str(i), "--shard-paths", 512, "--shard", f"{i}/3")
    capsys.readouterr()
    arguments = ["merge", str(tmp_path / "1"), str(tmp_path / "3"), "--out", str(tmp_path / "out"), "--quiet"]
    assert command_line.main(arguments) == command_line.BAD_INPUT
    shown = capsys.readouterr().err
    assert "4 of 11 shards" in shown and "moments-000002, moments-000005, paths-000001, paths-000004" in shown
    assert not (tmp_path / "out" / "moments.csv").exists()
    again = shown.partition("`symsde run ")[2].partition("`")[0].split()
    assert run(*again) == command_line.PATHS_FAILED  # the command given in the message
    assert (tmp_path / "out" / "moments.csv").exists()


def test_merging_what_does_not_fit_is_refused(file, tmp_path, capsys):
    other = write(tmp_path / "other.toml", ("seed = 9", "seed = 8"))
    for i, which in ((1, file), (2, other)):
        run(which, "--out", tmp_path / str(i), "--shard", f"{i}/2", "--shard-paths", 512)
    run(file, "--out", tmp_path / "3", "--shard", "2/2", "--shard-paths", 1024)
    capsys.readouterr()
    for one, two, said in (("1", "2", "seed = 9 there, 8 here"), ("1", "3", "shard_paths = 512 there, 1024 here")):
        folders = [str(tmp_path / name) for name in (one, two)]
        assert command_line.main(["merge", *folders, "--out", str(tmp_path / "out")]) == command_line.BAD_INPUT
        assert said in capsys.readouterr().err
        assert not (tmp_path / "out").exists()
    assert (
        command_line.main(["merge", str(tmp_path / "none"), "--out", str(tmp_path / "out")]) == command_line.BAD_INPUT
    )
    assert "none holds no run" in capsys.readouterr().err


@pytest.mark.parametrize("text", ["9/8", "0/8", "8", "a/b", "1/0", "-1/2", "1/2/3", ""])
def test_parts_that_do_not_exist_are_refused(text, file, tmp_path, capsys):
    code = run(file, "--out", tmp_path / "out", f"--shard={text}")
    if text:
        assert code == command_line.BAD_INPUT
        assert "give i" in capsys.readouterr().err and not (tmp_path / "out").exists()


@pytest.mark.parametrize("text", ["100", "300", "many", "0", "1e3"])
def test_sizes_of_shards_that_do_not_fit_the_tree_are_refused(text, file, tmp_path, capsys):
    assert run(file, "--out", tmp_path / "out", "--shard-paths", text) == command_line.BAD_INPUT
    assert "shard-paths" in capsys.readouterr().err


def test_a_damaged_shard_is_computed_anew(file, tmp_path, capsys):
    """Any damaged byte is noticed; the damaged file is kept aside."""
    out = tmp_path / "out"
    assert run(file, "--out", out, "--shard-paths", 1024) == command_line.PATHS_FAILED
    before = digest(out)
    shard = out / "shards" / "moments-000002.npz"
    content = shard.read_bytes()
    places = np.linspace(0, len(content) - 1, 12).astype(int)
    for place in places:
        damaged = bytearray(content)
        damaged[place] ^= 1 << (int(place) % 8)
        with pytest.raises(shard_file.DamagedShardError):
            shard_file.from_bytes(bytes(damaged), "it")
    for rest in (content[:-1], b"", content[: len(content) // 2], bytes(damaged)):
        shard.write_bytes(rest)
        capsys.readouterr()
        assert run(file, "--out", out) == command_line.PATHS_FAILED
        assert "moments-000002.npz is damaged" in capsys.readouterr().err
        (out / "shards" / "moments-000002.damaged").unlink()
        assert digest(out) == before


def test_a_shard_of_another_run_is_not_taken(file, tmp_path, capsys):
    other = write(tmp_path / "other.toml", ("seed = 9", "seed = 8"))
    for name, which in (("out", file), ("other", other)):
        assert run(which, "--out", tmp_path / name, "--shard-paths", 1024) == command_line.PATHS_FAILED
    before = digest(tmp_path / "out")
    strange = tmp_path / "other" / "shards" / "moments-000002.npz"
    shutil.copy(strange, tmp_path / "out" / "shards" / "moments-000002.npz")
    capsys.readouterr()
    assert run(file, "--out", tmp_path / "out") == command_line.PATHS_FAILED
    assert "it is the shard of another run" in capsys.readouterr().err
    (tmp_path / "out" / "shards" / "moments-000002.damaged").unlink()
    assert digest(tmp_path / "out") == before


SLOW = ("paths = 3000", "paths = 20000"), ("steps = 120", "steps = 1200"), ("midpoint", "stormer_verlet")


def test_two_writers_share_the_work(tmp_path):
    file = write(tmp_path / "scene.toml", *SLOW)
    environment = {**os.environ, "SYMSDE_NUM_THREADS": "1"}
    arguments = ("run", file, "--out", tmp_path / "out", "--shard-paths", "512")
    both = [command(*arguments, env=environment) for _ in range(2)]
    assert [process.wait() for process in both] == [command_line.PATHS_FAILED] * 2
    shards = tmp_path / "out" / "shards"
    assert len([path for path in shards.iterdir() if path.suffix != ".npz"]) == 0
    assert run(file, "--out", tmp_path / "alone", "--shard-paths", 512) == command_line.PATHS_FAILED
    assert digest(tmp_path / "out") == digest(tmp_path / "alone")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGUSR1])
def test_a_signal_ends_the_run_cleanly(number, tmp_path):
    file = write(tmp_path / "scene.toml", *SLOW)
    out = tmp_path / "out"
    given = words(int(number), 3, "shards/moments-", PLACED, "symsde", "run", file, "--out", out, "--shard-paths", 256)
    done = subprocess.run(given, capture_output=True, text=True, check=False)
    shown = done.stderr
    assert done.returncode == command_line.STOPPED
    assert f"stopped by {number.name}; " in shown and "resume with `symsde run " in shown and "Traceback" not in shown
    assert not (out / "moments.csv").exists()
    assert all(path.suffix == ".npz" for path in (out / "shards").iterdir())
    again = shown.partition("`symsde run ")[2].partition("`")[0].split()
    assert run(*again) == command_line.PATHS_FAILED
    assert run(file, "--out", tmp_path / "alone", "--shard-paths", 256) == command_line.PATHS_FAILED
    assert digest(out) == digest(tmp_path / "alone")


def test_a_long_piece_of_moments_gives_back_what_it_has(tmp_path, monkeypatch, capsys):
    """A single shard stopped in the middle: its moments up to the times that its paths reached are kept, and removed at
    the end."""
    (tmp_path / "scene.toml").write_text(
        '[model]\nname = "kubo"\n[run]\nstep = 0.02\nsteps = 40000000\nsave_every = 400000\n'
        "paths = 8\nq0 = 1.0\np0 = 0.0\n"
    )
    file = tmp_path / "scene.toml"
    out = tmp_path / "out"

    def gives_up(self, done, total, _begun):
        if done > total // 4:
            self._wish("a test")
        return done > total // 4

    with monkeypatch.context() as change:
        change.setattr(stop.Stop, "gives_up", gives_up)
        assert run(file, "--out", out) == command_line.STOPPED
    assert "moments.partial.csv holds moments" in capsys.readouterr().err
    rows = np.genfromtxt(table_of(out / "moments.partial.csv"), delimiter=",", skip_header=1)
    assert told(out / "moments.partial.csv")["paths_ok"] == "0"  # no path reached the last time
    known = rows[:, 1] == 8
    assert 1 <= known.sum() < 101 and known[: known.sum()].all() and (rows[known.sum() :, 1] == 0).all()
    assert np.isfinite(rows[known, 2:]).all() and np.isnan(rows[~known, 2]).all()
    assert run(file, "--out", out) == command_line.OK
    whole = np.genfromtxt(table_of(out / "moments.csv"), delimiter=",", skip_header=1)
    np.testing.assert_array_equal(rows[known], whole[known])
    assert not (out / "moments.partial.csv").exists()


def test_the_time_that_is_given_is_kept(tmp_path, capsys, monkeypatch):
    """With a clock that each shard advances by a second, as many shards are computed as fit into the time, and no shard
    is begun that would not fit.
    """
    now = [0.0]
    real = dispatch.compute

    def compute(*given):
        now[0] += 1.0
        return real(*given)

    monkeypatch.setattr(dispatch, "compute", compute)
    for module in (dispatch, stop):
        monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=lambda: now[0], sleep=None))
    file = write(tmp_path / "scene.toml", ("seed = 9", "seed = 9\nthreads = 1"))
    out = tmp_path / "out"
    assert run(file, "--out", out, "--shard-paths", 256, "--max-walltime", "4.5s") == command_line.STOPPED
    assert "stopped by --max-walltime" in capsys.readouterr().err
    assert 1 <= len(list((out / "shards").glob("*.npz"))) <= now[0] <= 5  # 13 shards in all; one is computed, one waits


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        *[("90", 90), ("1.5h", 5400), ("30min", 1800), ("10 s", 10), ("1d", 86400)],
        # as Slurm writes it: minutes:seconds, hours:minutes:seconds, days-hours, days-hours:minutes, ..:seconds
        *[("2:30", 150), ("90:00", 5400), ("0:07", 7), ("23:30:00", 84600), ("1:2:3", 3723), ("00:00:00", 0)],
        *[("1-12", 129600), ("0-1", 3600), ("2-0", 172800), ("1-12:00", 129600), ("1-12:30", 131400)],
        *[("0-12:00", 43200), ("0-01:30", 5400), ("1-02:03:04", 93784), ("0-0:0:9", 9), ("10-30:90:99", 977499)],
    ],
)
def test_wall_times(text, expected):
    assert stop.seconds("max-walltime", text) == expected


@pytest.mark.parametrize(
    "text",
    ["", "soon", "-3", "1:2:3:4", "5 weeks", "nan", "1-", "1-2:3:4:5", "1-2.5", "1.5:00", "1:", ":30", "1-12h", "٣"],
)
def test_wall_times_that_are_none(text):
    with pytest.raises(InvalidArgumentError, match="is no time: give"):
        stop.seconds("max-walltime", text)


FULL = """
import resource, sys
from symsde.cli import command_line as cli
resource.setrlimit(resource.RLIMIT_FSIZE, (3000, 3000))
sys.exit(cli.main(["run", sys.argv[1], "--out", sys.argv[2], "--shard-paths", "256"]))
"""


def test_a_full_disk_ends_the_run_and_costs_what_was_in_work(file, known, tmp_path):
    """A full disk is imitated by a limit of 3000 bytes a file, which one file exceeds."""
    given = [sys.executable, "-c", FULL, file, str(tmp_path / "out")]
    done = subprocess.run(given, capture_output=True, text=True, check=False)
    assert done.returncode == command_line.NOT_WRITTEN, done.stderr
    assert "cannot be written: File too large" in done.stderr and "Traceback" not in done.stderr
    names = {path.name for path in (tmp_path / "out" / "shards").iterdir()}
    assert all(name.endswith(".npz") for name in names)
    assert run(file, "--out", tmp_path / "out") == command_line.PATHS_FAILED
    is_known(tmp_path / "out", known)


@pytest.mark.skipif(os.geteuid() == 0 and not Path("/proc/self").exists(), reason="root may write everywhere")
def test_a_folder_that_takes_no_files_is_said(file, capsys):
    assert run(file, "--out", "/proc/self/deeper") == command_line.NOT_WRITTEN
    assert "nothing can be written to /proc/self/deeper" in capsys.readouterr().err


def test_the_time_of_day_does_not_matter(file, known, tmp_path, monkeypatch):
    """Results do not depend on a clock that goes back or stands still."""
    times = iter(range(10**9, 0, -1000))
    monkeypatch.setattr(time, "time", lambda: float(next(times)))
    monkeypatch.setattr(time, "time_ns", lambda: next(times) * 10**9)
    assert (
        run(file, "--out", tmp_path / "out", "--shard-paths", 512, "--max-walltime", "1h") == command_line.PATHS_FAILED
    )
    is_known(tmp_path / "out", known)


def test_a_folder_is_opened_finished_or_not(known, file, tmp_path, capsys):
    run(file, "--out", tmp_path / "out", "--shard-paths", 1024, "--shard", "1/2")
    half = ss.open_run(tmp_path / "out")
    assert half.missing == ["moments-000002", "moments-000004", "paths-000002", "paths-000004"]
    first = half.moments
    assert first.report.outcome == "stopped on request" and first.report.stopped == 3000 - first.n_ok[0]
    part = ss.moments(half.scene.model, **{**half.scene.run, "paths": 256})
    tree = Tree()
    for index, of in (
        (0, part),
        (2, ss.moments(half.scene.model, **{**half.scene.run, "first_path": 2048, "paths": 1024})),
    ):
        tree.insert(10, index, node(of))
    np.testing.assert_array_equal(first.m2, tree.root().m2)
    run(file, "--out", tmp_path / "out")
    whole = ss.open_run(str(tmp_path / "out"))
    assert whole.missing == [] and whole.manifest["seed"] == 9 and "of 8 shards" in repr(whole)
    whole.moments.save(tmp_path / "again.csv")
    assert table_of(tmp_path / "again.csv") == known[0]
    np.testing.assert_array_equal(whole.run.q, known[1].q)
    assert whole.run.report.failed == (known[1].status != 0).sum()
    with pytest.raises(ss.errors.SceneError, match="holds no run"):
        ss.open_run(tmp_path)


OWN = """
import symsde as ss
def make(stiffness):
    def gradient(t, w, q, p):
        return (w[0] * stiffness + w[1]) * q, w[0] * p
    return ss.Model(ndof=1, nnoise=1, gradient=gradient, separable=True, quadratic=True)
"""


def test_models_in_python_are_part_of_the_run(tmp_path, capsys):
    """The model's file is copied beside the scene and belongs to the run's inputs: another text is another run."""
    text = '[model]\npython = "own_of_batch:make"\nstiffness = 2.0\n[run]\nstep = 0.1\nsteps = 10\npaths = 600\n'
    file = write(tmp_path / "scene.toml", text=text + "q0 = 1.0\np0 = 0.0\n")
    (tmp_path / "own_of_batch.py").write_text(OWN)
    assert run(file, "--allow-python", "--out", tmp_path / "out", "--shard-paths", 256) == command_line.OK
    assert (tmp_path / "out" / "own_of_batch.py").read_text() == OWN
    merged = ["merge", str(tmp_path / "out"), "--out", str(tmp_path / "merged"), "--quiet"]
    assert command_line.main(merged) == command_line.BAD_INPUT
    assert "--allow-python" in capsys.readouterr().err
    assert command_line.main([*merged, "--allow-python"]) == command_line.OK
    assert digest(tmp_path / "merged") == digest(tmp_path / "out")
    (tmp_path / "own_of_batch.py").write_text(OWN + "# otherwise\n")
    assert run(file, "--allow-python", "--out", tmp_path / "out") == command_line.BAD_INPUT
    assert "python_sha256" in capsys.readouterr().err
