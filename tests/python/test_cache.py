# SPDX-License-Identifier: BSD-3-Clause
"""Compiled formulas on disk: a library put there by another user never runs, nor does an incomplete one."""

import ctypes
import hashlib
import os
import subprocess
import sys

import pytest
from symsde import errors
from symsde.model.formulas import cache, compiler

if compiler.command() is None:
    pytest.skip("no C compiler", allow_module_level=True)

pytestmark = pytest.mark.optimised  # as in the processes that these tests start

SOURCE = "double formula_value(void) { return 1.0; }\n"
OTHER = 12345  #: a user id other than this process's
needs_root = pytest.mark.skipif(os.geteuid() != 0, reason="only root gives files to others")
ASK = """
import ctypes, sys
from symsde.model.formulas import compiler
made = compiler.build(sys.argv[1])
made.library.formula_value.restype = ctypes.c_double
print(made.library.formula_value(), made.seconds > 0)
"""


@pytest.fixture(autouse=True)
def anew(monkeypatch, tmp_path_factory):
    """A state as in a new process with nothing loaded and a usual umask."""
    monkeypatch.setattr(cache, "_loaded", {})
    before = os.umask(0o022)
    yield
    os.umask(before)


@pytest.fixture(scope="module")
def evil(tmp_path_factory):
    """A library that leaves a file when loaded: its bytes, and the file."""
    place = tmp_path_factory.mktemp("evil")
    text, marker = place / "evil.c", place / "ran"
    text.write_text(
        f'#include <stdio.h>\n__attribute__((constructor)) static void run(void) {{ fopen("{marker}", "w"); }}\n'
        "double formula_value(void) { return 666.0; }\n"
    )
    words = [*compiler.command(), *compiler.FLAGS, "-o", str(place / "evil.so"), str(text)]
    subprocess.run(words, check=True)
    return (place / "evil.so").read_bytes(), marker


def built(place, monkeypatch):
    monkeypatch.setenv("SYMSDE_CACHE", str(place))
    return compiler.build(SOURCE)


def value(made):
    function = made.library.formula_value
    function.restype = ctypes.c_double
    return function()


def plant(place, evil, monkeypatch, tmp_path):
    """Put the evil library, with its checksum, where the library for this text would be."""
    name = built(tmp_path / "clean", monkeypatch).path.name
    cache._loaded.clear()
    place.mkdir(parents=True, exist_ok=True)
    (place / name).write_bytes(evil[0])
    (place / name).with_suffix(".sha256").write_text(f"{hashlib.sha256(evil[0]).hexdigest()}  {name}\n")
    return place / name


def give_away(*paths):
    for path in paths:
        os.chown(path, OTHER, OTHER, follow_symlinks=False)


def open_folder(mode):
    def change(place, _):
        place.chmod(mode)

    return change


def open_parent(place, _):
    place.parent.chmod(0o775)


def linked_from_an_open_place(place, _):
    """A link of this user inside a folder in which others can replace it."""
    real = place.rename(place.with_name("real"))
    (place.parent / "open").mkdir()
    (place.parent / "open").chmod(0o777)
    (place.parent / "open" / "on").symlink_to(real)
    place.symlink_to("open/on")


def link_of_another(place, _):
    place.symlink_to(place.rename(place.with_name("real")))
    give_away(place)


def folder_of_another(place, _):
    give_away(place)


def parent_of_another(place, _):
    give_away(place.parent)


FOLDERS = {
    "0775": open_folder(0o775),
    "0777": open_folder(0o777),
    "1777": open_folder(0o1777),
    "parent": open_parent,
    "linked": linked_from_an_open_place,
    "link of another": pytest.param(link_of_another, marks=needs_root),
    "of another": pytest.param(folder_of_another, marks=needs_root),
    "parent of another": pytest.param(parent_of_another, marks=needs_root),
}


@pytest.mark.parametrize("change", FOLDERS.values(), ids=FOLDERS)
def test_a_folder_that_others_can_write_is_not_used(change, evil, tmp_path, monkeypatch):
    place = tmp_path / "above" / "cache"
    monkeypatch.setattr(cache, "_OTHERS_ENTER", 0o777)  # temporary folders count as open to others, wherever they are
    planted = plant(place, evil, monkeypatch, tmp_path)
    planted.parent.parent.chmod(0o755)
    planted.parent.chmod(0o755)
    change(place, planted)
    with pytest.warns(errors.SlowFormulaWarning, match="not kept in .*cache, since others could put code there: "):
        made = built(place, monkeypatch)
    assert value(made) == 1.0 and not evil[1].exists()
    assert made.path.parent == cache._own_folder()


def link_to_it(planted, tmp_path):
    planted.symlink_to(planted.rename(tmp_path / "elsewhere.so"))


def open_file(planted, _):
    planted.chmod(0o664)


def file_of_another(planted, _):
    give_away(planted)


def checksum_of_another(planted, _):
    give_away(planted.with_suffix(".sha256"))


def pipe(planted, _):
    planted.unlink()
    os.mkfifo(planted)


FILES = {
    "link": link_to_it,
    "0664": open_file,
    "pipe": pipe,
    "of another": pytest.param(file_of_another, marks=needs_root),
    "checksum of another": pytest.param(checksum_of_another, marks=needs_root),
}


@pytest.mark.parametrize("change", FILES.values(), ids=FILES)
def test_a_file_that_others_can_write_is_made_again(change, evil, tmp_path, monkeypatch):
    planted = plant(tmp_path / "cache", evil, monkeypatch, tmp_path)
    planted.parent.chmod(0o700)
    change(planted, tmp_path)
    made = built(tmp_path / "cache", monkeypatch)
    assert value(made) == 1.0 and made.seconds > 0 and not evil[1].exists()
    assert made.path == planted and not planted.is_symlink() and planted.stat().st_uid == os.geteuid()


def test_the_plant_would_run(evil, tmp_path, monkeypatch):
    """With this user's permissions the planted library runs, so the tests above can fail."""
    planted = plant(tmp_path / "cache", evil, monkeypatch, tmp_path)
    planted.parent.chmod(0o700)
    assert value(built(tmp_path / "cache", monkeypatch)) == 666.0 and evil[1].exists()
    evil[1].unlink()


@pytest.mark.parametrize("share", [0.0, 0.2, 0.5, 0.8, 0.95])
def test_a_file_that_is_cut_off_is_made_again(share, tmp_path, monkeypatch):
    """A library file that is cut off is made again: the loader would read beyond its end, and SIGBUS would end the
    process.
    """
    path = built(tmp_path, monkeypatch).path
    whole = path.read_bytes()
    os.truncate(path, int(share * len(whole)))
    for is_made in ("True", "False"):
        ended = subprocess.run([sys.executable, "-c", ASK, SOURCE], capture_output=True, text=True, check=False)
        assert ended.stdout.split() == ["1.0", is_made], (ended.returncode, ended.stderr)
    assert path.read_bytes() == whole


@pytest.mark.parametrize("has_checksum", [True, False])
def test_a_library_without_the_functions_is_made_again(has_checksum, tmp_path, monkeypatch):
    """A library made from another text, but stored under this text's name, is made again."""
    made = built(tmp_path, monkeypatch)
    other = compiler.build("double another(void) { return 2.0; }\n")
    made.path.write_bytes(other.path.read_bytes())
    if not has_checksum:
        made.path.with_suffix(".sha256").unlink()
    cache._loaded.clear()
    again = built(tmp_path, monkeypatch)
    assert value(again) == 1.0 and again.seconds > 0


def test_what_was_checked_is_loaded(evil, tmp_path, monkeypatch):
    """The bytes that were checked are loaded, even if the file is exchanged between check and loading."""
    path, load = built(tmp_path, monkeypatch).path, cache._from_memory
    cache._loaded.clear()

    def exchanged(content):
        path.write_bytes(evil[0])
        return load(content)

    monkeypatch.setattr(cache, "_from_memory", exchanged)
    again = built(tmp_path, monkeypatch)
    assert value(again) == 1.0 and again.seconds == 0 and not evil[1].exists()


def test_what_is_loaded_outlives_its_file(tmp_path, monkeypatch):
    """A loaded library works on when its file is cut off or removed."""
    monkeypatch.setenv("SYMSDE_CACHE", str(tmp_path))
    program = "import os\n" + ASK.replace("made.library.f", "os.truncate(made.path, 0)\nmade.library.f", 1)
    ended = subprocess.run([sys.executable, "-c", program, SOURCE], capture_output=True, text=True, check=False)
    assert ended.stdout.split() == ["1.0", "True"], (ended.returncode, ended.stderr)


def test_each_text_has_its_own_library(tmp_path, monkeypatch):
    """The loader identifies libraries by path, and numbers of file descriptors are used again: each text still gets
    its own library.
    """
    monkeypatch.setenv("SYMSDE_CACHE", str(tmp_path))
    for _ in range(2):
        made = [compiler.build(f"double formula_value(void) {{ return {i}.0; }}\n") for i in range(5)]
        assert [value(x) for x in made] == [0.0, 1.0, 2.0, 3.0, 4.0]
        cache._loaded.clear()
    assert compiler.build(SOURCE).library is compiler.build(SOURCE).library


def test_where_nothing_is_loaded_from_memory(tmp_path, monkeypatch):
    """On systems other than Linux libraries are loaded by name, from a folder that nobody else can write to."""
    monkeypatch.delattr(os, "memfd_create")
    made = built(tmp_path, monkeypatch)
    assert value(made) == 1.0 and str(made.path) == made.library._name


def test_folders_are_made_for_this_user_alone(tmp_path, monkeypatch):
    """Folders are made for this user alone, whatever the umask; files are private, too."""
    os.umask(0)
    made = built(tmp_path / "above" / "cache", monkeypatch)
    assert made.path.parent == tmp_path / "above" / "cache"
    for path in (made.path.parent, made.path.parent.parent):
        assert path.stat().st_mode & 0o777 == 0o700
    files = list(made.path.parent.iterdir())
    assert len(files) == 3 and all(path.stat().st_mode & 0o777 == 0o600 for path in files)


def test_modes_below_a_closed_folder(tmp_path):
    """Modes inside a closed folder do not matter, since nobody can enter; but a link may lead out of it, or nowhere."""
    inside, outside = tmp_path / "closed" / "open", tmp_path / "outside"
    for folder in (inside, outside):
        folder.mkdir(parents=True)
        folder.chmod(0o777)
    inside.parent.chmod(0o700)
    assert cache.open_to_others(inside) is None
    tmp_path.chmod(0o755)
    for name, target in (("absolute", outside), ("relative", "../outside"), ("turn", "turn")):
        (inside.parent / name).symlink_to(target)
    assert cache.open_to_others(inside.parent / "turn") == inside.parent / "turn"
    before = cache.open_to_others(outside)  # None if the folder of temporary files is closed to others
    assert [cache.open_to_others(inside.parent / x) for x in ("absolute", "relative")] == [before, outside]


def test_a_compiler_may_come_with_a_package(monkeypatch):
    """A package's compiler is used if the system has none, and the system's first otherwise."""
    assert "ziglang" not in compiler.command()
    with monkeypatch.context() as without:
        without.setattr(compiler.shutil, "which", lambda _: None)
        for there, wanted in ((object(), [sys.executable, "-m", "ziglang", "cc"]), (None, None)):
            without.setattr(compiler.importlib.util, "find_spec", {"ziglang": there}.get)
            assert compiler.command() == wanted
