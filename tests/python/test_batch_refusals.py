# SPDX-License-Identifier: BSD-3-Clause
"""Messages about folders, manifests, parts and options that do not fit: each names the mismatch and says how to go
on.
"""

import json
import re
import shlex
import shutil
import signal

import pytest
import symsde as ss
from symsde.batch import error_check, manifest
from symsde.batch import scene as scenes
from symsde.batch.pieces import Piece
from symsde.batch.share import Share, parts_of
from symsde.cli import command_line

SCENE = """
[model]
name = "kubo"
[run]
step = 0.1
steps = 10
paths = 2000
q0 = 1.0
p0 = 0.0
save_every = 5
[output]
paths = [0, 700]
"""  # eight shards of moments, two of paths


@pytest.fixture(scope="module")
def parts(tmp_path_factory):
    """Two parts, in folders of their own, and their scene."""
    place = tmp_path_factory.mktemp("parts")
    (place / "scene.toml").write_text(SCENE)
    for i in (1, 2):
        given = [place / "scene.toml", "--out", place / f"part{i}", "--shard", f"{i}/2", "--shard-paths", 256]
        assert command_line.main(["run", *map(str, given), "--quiet"]) == 0
    return place


@pytest.fixture
def place(parts, tmp_path):
    shutil.copytree(parts, tmp_path / "it")
    return tmp_path / "it"


def merge(place, *folders):
    folders = folders or ("part1", "part2")
    return command_line.main(
        ["merge", *(str(place / name) for name in folders), "--out", str(place / "out"), "--quiet"]
    )


def edit(folder, **changes):
    """Change entries of a manifest, as another version or build would write them."""
    path = folder / "manifest.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), **changes}))


def test_a_part_tells_how_many_shards_are_there(parts, tmp_path, capsys):
    given = [parts / "scene.toml", "--out", tmp_path / "one", "--shard", "1/3", "--shard-paths", 256]
    assert command_line.main(["run", *map(str, given)]) == 0
    there = len(list((tmp_path / "one" / "shards").iterdir()))
    assert there in (3, 4) and f"part 1/3 is done: {there} of 10 shards are in {tmp_path}" in capsys.readouterr().out


def test_parts_that_fit(place):
    assert merge(place) == 0 and (place / "out" / "moments.csv").exists()


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"version": "9.9"}, "version = '9.9' there"),
        ({"compiler": "other"}, "compiler = 'other' there"),
        ({"build": "-Ofast"}, "build = '-Ofast' there"),
        ({"counter_map": "1"}, "counter_map = '1' there, '2' here"),
        ({"seed": 5}, "seed = 5 there, 0 here"),
        ({"shard_paths": 512}, "shard_paths = 512 there, 256 here"),
    ],
)
def test_parts_of_another_make_are_not_merged(changes, sentence, place, capsys):
    edit(place / "part1", **changes)
    assert merge(place) == command_line.BAD_INPUT
    shown = capsys.readouterr().err
    assert "part1 and " in shown and "part2 hold parts of different runs: " in shown and sentence in shown
    assert "merge parts of one scene, made with one version and build" in shown
    assert not (place / "out").exists()


NO_MANIFEST = {
    "no JSON": b"{",
    "a list": b"[1]",
    "no text": b"\xff\xfe",
    "nothing": b"",
    "a format alone": b'{"format": 1}',
}


@pytest.mark.parametrize("content", NO_MANIFEST.values(), ids=NO_MANIFEST)
def test_what_is_no_manifest(content, place, capsys):
    (place / "part1" / "manifest.json").write_bytes(content)
    assert merge(place) == command_line.BAD_INPUT
    assert "manifest.json is no manifest of a run: give another folder, or remove this one" in capsys.readouterr().err
    with pytest.raises(ss.errors.SceneError, match="is no manifest of a run"):
        ss.open_run(place / "part1")


@pytest.mark.parametrize("size", [300, -256, 0, "256", None, 128, True])
def test_a_manifest_with_a_size_that_is_none(size, place, capsys):
    edit(place / "part1", shard_paths=size)
    assert (
        command_line.main(["run", str(place / "scene.toml"), "--out", str(place / "part1")]) == command_line.BAD_INPUT
    )
    assert "is no manifest of a run" in capsys.readouterr().err


def test_a_manifest_of_another_format(place, capsys):
    edit(place / "part1", format=3)
    assert merge(place) == command_line.BAD_INPUT
    assert "manifest.json has format 3, this symsde knows 2: use the version that made it" in capsys.readouterr().err


def test_a_manifest_whose_inputs_were_changed(place, capsys):
    path = place / "part1" / "manifest.json"
    path.write_text(path.read_text().replace('"steps": 10', '"steps": 20'))
    assert merge(place) == command_line.BAD_INPUT
    assert "is no manifest of a run" in capsys.readouterr().err


def test_a_manifest_that_cannot_be_read(place, capsys):
    (place / "part1" / "manifest.json").unlink()
    (place / "part1" / "manifest.json").mkdir()
    assert merge(place) == command_line.BAD_INPUT
    assert "manifest.json cannot be read: Is a directory: give another folder" in capsys.readouterr().err


def test_folders_that_hold_no_run(place, capsys):
    for name in ("nowhere", "scene.toml"):
        assert merge(place, name, "part2") == command_line.BAD_INPUT
        shown = capsys.readouterr().err
        assert f"{name} holds no run (no manifest.json): give folders that `symsde run` has written" in shown


def test_no_folder_at_all(place, capsys):
    with pytest.raises(SystemExit) as stopped:
        command_line.main(["merge", "--out", str(place / "out")])
    assert stopped.value.code == command_line.BAD_INPUT and "DIR" in capsys.readouterr().err


def test_a_scene_that_is_not_that_of_its_shards(place, capsys):
    path = place / "part1" / "scene.toml"
    path.write_text(SCENE.replace("step = 0.1", "step = 0.2"))
    assert merge(place) == command_line.BAD_INPUT
    assert "part1 holds another run: run.step = 0.1 there, 0.2 here" in capsys.readouterr().err
    with pytest.raises(ss.errors.SceneError, match=r"not the scene of the shards: run.step = 0.1 there, 0.2 in"):
        ss.open_run(place / "part1")
    path.unlink()
    assert merge(place) == command_line.BAD_INPUT
    assert "part1/scene.toml cannot be read: No such file" in capsys.readouterr().err


def test_a_whole_that_is_another_run(place, capsys):
    (place / "other.toml").write_text(SCENE.replace("paths = 2000", "paths = 2000\nseed = 4"))
    assert command_line.main(["run", str(place / "other.toml"), "--out", str(place / "out"), "--quiet"]) == 0
    before = (place / "out" / "moments.csv").read_bytes()
    assert merge(place) == command_line.BAD_INPUT
    assert "out holds another run: run.seed = 4 there, 0 here" in capsys.readouterr().err
    assert (place / "out" / "moments.csv").read_bytes() == before


def test_a_whole_that_holds_something_else(place, capsys):
    (place / "out" / "shards").mkdir(parents=True)
    assert merge(place) == command_line.BAD_INPUT
    assert "out holds shards but no manifest.json" in capsys.readouterr().err


def test_a_whole_that_cannot_be_written(place, capsys):
    given = ["merge", str(place / "part1"), str(place / "part2"), "--out", "/proc/self/whole"]
    assert command_line.main(given) == command_line.NOT_WRITTEN
    assert "nothing can be written to /proc/self/whole" in capsys.readouterr().err


def test_missing_shards_are_named_with_what_makes_them(place, capsys):
    assert merge(place, "part1") == command_line.BAD_INPUT
    shown = capsys.readouterr().err
    assert "5 of 10 shards are in none of the folders: moments-000002, moments-000004, moments-000006" in shown
    again = re.search("`symsde (run [^`]*)` computes them and ends the run; they are what `--shard 2/2` of", shown)
    assert command_line.main([*again[1].split(), "--quiet"]) == 0  # the command given in the message
    assert merge(place) == 0


def test_many_missing_shards_are_counted(place, capsys):
    for path in (place / "part1" / "shards").iterdir():
        path.unlink()
    (place / "part2" / "shards" / "moments-000002.npz").unlink()
    (place / "part2" / "shards" / "moments-000004.npz").unlink()
    (place / "part2" / "shards" / "paths-000002.npz").unlink()
    assert merge(place, "part1", "part2") == command_line.BAD_INPUT
    shown = capsys.readouterr().err
    assert "8 of 10 shards" in shown and "moments-000007, paths-000001, paths-000002" in shown and " more" not in shown
    (place / "part2" / "shards" / "moments-000006.npz").unlink()
    shutil.rmtree(place / "out")
    assert merge(place) == command_line.BAD_INPUT
    assert "9 of 10 shards" in (shown := capsys.readouterr().err) and " and 1 more: " in shown


def test_which_parts_are_missing():
    pieces = [Piece(f"moments-{i:06d}", "moments", 256 * i, 256, 1) for i in range(12)]
    for n, lacking in ((3, [2]), (4, [1, 3]), (6, [6])):
        missing = [piece for i in lacking for piece in Share(i, n).of(pieces)]
        found = parts_of(missing, pieces)
        assert sorted(x.name for share in found for x in share.of(pieces)) == sorted(x.name for x in missing)
    assert parts_of(pieces[1::2], pieces) == [Share(2, 2)]
    assert parts_of(pieces[:1], pieces) == [] == parts_of(pieces, pieces)


DAMAGES = {
    "a byte": lambda content: content[:200] + bytes([content[200] ^ 1]) + content[201:],
    "its end": lambda content: content[:-1],
    "all of it": lambda content: b"",
    "its checksum": lambda content: content[:-64] + b"0" * 64,
}


@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES)
def test_a_damaged_part_is_named_and_counts_as_missing(damage, place, capsys):
    path = place / "part1" / "shards" / "moments-000003.npz"
    path.write_bytes(damage(path.read_bytes()))
    assert merge(place) == command_line.BAD_INPUT
    shown = capsys.readouterr().err
    assert "moments-000003.npz is damaged: its checksum is not that of its" in shown and "it is left out" in shown
    assert "1 of 10 shards are in none of the folders: moments-000003: `symsde run" in shown
    assert path.exists()  # the file of another writer


def test_a_damaged_part_that_another_folder_has_is_taken_from_there(place, capsys):
    shutil.copytree(place / "part1", place / "copy")
    (place / "part1" / "shards" / "moments-000003.npz").write_bytes(b"x")
    assert merge(place, "part1", "copy", "part2") == 0
    assert "moments-000003.npz is damaged" in capsys.readouterr().err


def test_a_shard_of_another_name(place, capsys):
    shards = place / "part1" / "shards"
    shutil.copy(shards / "moments-000001.npz", shards / "moments-000003.npz")
    assert merge(place) == command_line.BAD_INPUT
    assert "moments-000003.npz is damaged: it is the shard of another run or piece" in capsys.readouterr().err


def test_a_shard_that_cannot_be_read(place, capsys):
    path = place / "part1" / "shards" / "moments-000003.npz"
    path.unlink()
    path.mkdir()
    for verb in (
        lambda: merge(place),
        lambda: command_line.main(["run", str(place / "scene.toml"), "--out", str(path.parents[1])]),
    ):
        assert verb() == command_line.NOT_WRITTEN
        assert "moments-000003.npz cannot be read: Is a directory: remove it" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--shard", "9/8"], "shard = 9/8: there is no part 9 of 8: give i from 1 to n, as 1/8 for the first"),
        (["--shard", "0/8"], "there is no part 0 of 8"),
        (["--shard", "1/0"], "there is no part 1 of 0: give i from 1 to n, as 1/1"),
        (["--shard", ""], "shard = '' is no part of a run: give i/n, as 1/8 for the first of eight"),
        (["--shard", "/8"], "shard = '/8' is no part of a run"),
        (["--shard=-1/8"], "shard = '-1/8' is no part of a run"),
        (["--max-walltime", "soon"], "max-walltime = 'soon' is no time: give 90s, 30min, 23.5h, 23:30:00 or 1-12:00"),
        (["--max-walltime", ""], "max-walltime = '' is no time"),
        (["--checkpoint", "-1"], "checkpoint = '-1' is no time"),
        (["--shard-paths", "300"], "shard-paths = 300 is not a power of two"),
        (["--shard-paths", ""], "shard-paths"),
        (["--shard-paths", "²"], "shard-paths = '²' is not a whole number"),
        (["--shard-paths=-256"], "shard-paths = -256 is out of range: give an integer from 256"),
        (["--out", ""], "--out is empty: give a folder, or leave it out"),
    ],
)
def test_options_that_mean_nothing(options, sentence, place, capsys):
    given = ["run", str(place / "scene.toml"), "--out", str(place / "out"), *options]
    assert command_line.main(given) == command_line.BAD_INPUT
    assert sentence in capsys.readouterr().err
    assert not (place / "out").exists()


def test_a_part_of_more_than_there_are_shards(place, capsys):
    """A part that has no shards makes no folder and prints a message; it succeeds, since the other parts do the
    work."""
    given = ["run", str(place / "scene.toml"), "--out", str(place / "out"), "--shard", "11/12"]
    assert command_line.main([*given, "--shard-paths", "256"]) == command_line.OK
    told = "symsde: part 11/12 has nothing to do: the run is cut into 10 shards: give as many parts at most\n"
    shown = capsys.readouterr()
    assert told in shown.err and "is done" not in shown.out
    assert command_line.main([*given, "--shard-paths", "512"]) == command_line.OK
    finer = "cut into 6 shards: give as many parts at most, or --shard-paths 256 and 10 parts at most, in all parts"
    assert finer in capsys.readouterr().err
    assert not (place / "out").exists()


@pytest.mark.parametrize("part", ["4/4", "9/9", "10/10"])
def test_advice_for_more_parts_can_be_followed(part, place, capsys):
    """The message suggests a size of shards; with this size the part has work, in a new folder."""
    given = ["run", str(place / "scene.toml"), "--out", str(place / "new"), "--quiet", "--shard"]
    assert command_line.main([*given, part]) == command_line.OK
    size = re.search(r"--shard-paths (\d+), in all parts", capsys.readouterr().err)[1]
    assert command_line.main([*given, part, "--shard-paths", size]) == command_line.OK
    assert not capsys.readouterr().err and len(list((place / "new" / "shards").iterdir())) == 1


def test_a_part_without_work_still_looks_whose_folder_it_is(place, capsys):
    (place / "scene.toml").write_text(SCENE.replace("q0 = 1.0", "q0 = 2.0"))
    given = ["run", str(place / "scene.toml"), "--out", str(place / "part1"), "--shard", "99/99"]
    assert command_line.main(given) == command_line.BAD_INPUT
    assert "run.q0 = 1 there, 2 here" in capsys.readouterr().err


def test_a_signal_ends_the_error_check(place, capsys, monkeypatch):
    """No incomplete table is written; the same command then makes it."""
    scene = place / "long.toml"  # a long run: no thread finishes before the calling thread begins
    scene.write_text(SCENE.replace("steps = 10\n", "steps = 20000\n").replace("save_every = 5", "save_every = 10000"))
    given = ["run", str(scene), "--out", str(place / "checked"), "--quiet", "--error-check"]
    real = error_check.simulate

    def simulate(*arguments, **options):
        signal.raise_signal(signal.SIGTERM)
        return real(*arguments, **options)

    with monkeypatch.context() as patch:
        patch.setattr(error_check, "simulate", simulate)
        assert command_line.main(given) == command_line.STOPPED
    said = capsys.readouterr().err
    assert "stopped by SIGTERM" in said and "--error-check`" in said
    assert (place / "checked" / "moments.csv").exists() and not (place / "checked" / "error-check.csv").exists()
    assert command_line.main(given) == command_line.OK and (place / "checked" / "error-check.csv").exists()


def test_the_error_check_is_not_left_out_silently(place, capsys):
    given = ["run", str(place / "scene.toml"), "--out", str(place / "part1"), "--quiet", "--error-check"]
    assert command_line.main([*given, "--shard", "1/2"]) == command_line.OK
    assert "symsde: a part makes no --error-check: give it to `symsde run`" in capsys.readouterr().err
    assert command_line.main([*given[:4], "--dry-run", "--error-check"]) == command_line.OK
    assert "not counted: --error-check" in capsys.readouterr().out
    other = place / "other.toml"
    other.write_text(SCENE.replace("paths = 2000", "paths = 2000\nseed = 4"))
    assert command_line.main(["run", str(other), *given[2:4], "--dry-run"]) == command_line.BAD_INPUT
    assert "holds another run: " in capsys.readouterr().err
    assert command_line.main([*given, "--max-walltime", "0"]) == command_line.STOPPED
    assert "part1 --error-check`" in capsys.readouterr().err
    assert not (place / "part1" / "error-check.csv").exists()
    assert command_line.main(given) == command_line.OK and (place / "part1" / "error-check.csv").exists()


def test_a_refusal_leaves_the_output_of_the_program_alone(place, capfd):
    """A refused command leaves the standard output of a calling program open."""
    assert command_line.main(["merge", str(place / "part1"), "--out", "/proc/self/whole"]) == command_line.NOT_WRITTEN
    print("still there", flush=True)
    assert "still there" in capfd.readouterr().out


def test_the_command_without_a_verb_shows_its_verbs(capsys):
    assert command_line.main([]) == command_line.BAD_INPUT
    said = capsys.readouterr()
    assert not said.out and "usage: symsde" in said.err and "Run a scene in a folder of shards" in said.err


@pytest.mark.parametrize("check", [(), ("--error-check",)])
@pytest.mark.parametrize("trusted", [(), ("--allow-python",)])
@pytest.mark.parametrize("part", [(), ("--shard", "2/3")])
def test_what_a_stopped_run_says_is_its_command(part, trusted, check, tmp_path, capsys):
    """A run or part stopped before its begin prints a command, which computes exactly this run or part."""
    file, flags = tmp_path / "scene.toml", (*part, *trusted, *check)
    file.write_text(SCENE)

    def run(*given):
        return command_line.main(["run", *map(str, given), "--quiet"])

    begun = (file, "--shard-paths", 256, *flags)
    assert run(*begun, "--out", tmp_path / "o ut", "--max-walltime", "0.001s") == command_line.STOPPED
    again = shlex.split(capsys.readouterr().err.partition("resume with `symsde run ")[2].partition("`")[0])
    assert again[:3] == [str(file), "--out", str(tmp_path / "o ut")] and sorted(again[3:]) == sorted(flags)
    assert run(*again) == run(*begun, "--out", tmp_path / "alone") == command_line.OK
    one, other = ({x.name: x.read_bytes() for x in (tmp_path / out / "shards").iterdir()} for out in ("o ut", "alone"))
    assert one == other and len(one) == (3 if part else 10)
    assert (tmp_path / "o ut" / "moments.csv").exists() == (not part)
    assert (tmp_path / "o ut" / "error-check.csv").exists() == (not part and bool(check))


OTHER = {
    "scheme": "gauss2", "step": 0.2, "steps": 20, "paths": 2001, "seed": 7, "t0": 0.5, "save_every": 10, "refine": 1,
    "first_path": 500, "first_step": 4, "correction": "none", "truncation": [2.0, 5.0], "areas": "law",
    "area_time": 2.0, "common_noise": [1], "compensated": True, "general": True, "fixed_point": 4, "max_iter": 90,
    "q0": 1.1, "p0": 0.1,
}  # fmt: skip


def test_only_threads_and_lanes_are_no_part_of_a_run(tmp_path):
    """A scene with any other key changed is another run, which the folder refuses; each key is tried."""
    file, how = tmp_path / "scene.toml", ("threads", "lanes")
    base = SCENE.replace("kubo", "noncommutative_oscillator").replace("[0, 700]", "[700]")
    base = base.replace("step = 0.1", 'scheme = "midpoint_areas"\nstep = 0.1')

    def inputs(**changed):
        old = "\n".join(f"{key} = {json.dumps(value)}" for key, value in changed.items())
        kept = [line for line in base.splitlines() if line.partition(" = ")[0] not in changed]
        file.write_text("\n".join(kept).replace("[run]", f"[run]\n{old}"))
        return manifest.of_scene(scenes.load(file), 256)["hash"]

    plain = inputs()
    assert {*OTHER, *how, "damping_noise", "save_at"} == set(scenes.RUN_KEYS) - {"q0_low", "p0_low"}
    assert [key for key, value in OTHER.items() if inputs(**{key: value}) == plain] == []
    assert inputs(threads=2) == inputs(lanes=32) == plain
    every, base = base, "\n".join(line for line in base.splitlines() if "save_every" not in line)
    assert inputs(save_at=[0.0, 0.1]) not in (plain, inputs())
    base = every
    base = SCENE.replace("kubo", "synchrotron").replace("[run]", 'damping = 1.0\n[run]\nscheme = "gauss_dkdkd"')
    assert inputs(damping_noise="path") != inputs() == inputs(damping_noise="law")
