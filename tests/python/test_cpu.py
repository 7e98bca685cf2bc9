# SPDX-License-Identifier: BSD-3-Clause
"""The variant of the library for a processor. tests/install/check_wheel.py runs the variants themselves."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from symsde.errors import InvalidArgumentError, LibraryNotFoundError
from symsde.native import cpu

NEHALEM = {"cx16", "lahf_lm", "popcnt", "sse4_1", "sse4_2", "ssse3", "sse2"}
HASWELL = NEHALEM | {"abm", "avx", "avx2", "bmi1", "bmi2", "f16c", "fma", "movbe", "xsave"}
SKYLAKE = HASWELL | {"avx512bw", "avx512cd", "avx512dq", "avx512f", "avx512vl"}


def test_the_flags_of_the_first_processor_are_read():
    assert cpu.flags("processor : 0\nflags\t\t: sse2 avx fma\nvmx flags : vnmi\nflags : sse2\n") == {
        "sse2",
        "avx",
        "fma",
    }
    assert cpu.flags("Features : fp asimd\n") == set()


@pytest.mark.parametrize(
    "have, levels",
    [
        (SKYLAKE, ["v4", "v3", "baseline"]),
        (SKYLAKE - {"avx512vl"}, ["v3", "baseline"]),
        (HASWELL - {"movbe"}, ["baseline"]),
        (SKYLAKE - {"fma"}, ["baseline"]),  # a level needs the features of all levels below it
        (SKYLAKE - {"popcnt"}, ["baseline"]),
        (set(), ["baseline"]),
    ],
)
def test_levels_of_a_processor(have, levels):
    assert cpu.supported(have) == levels
    assert cpu.wanted(None, have) == levels


def test_a_choice_is_taken_or_refused():
    assert cpu.wanted("v3", SKYLAKE) == ["v3"] and cpu.wanted("baseline", set()) == ["baseline"]
    with pytest.raises(InvalidArgumentError, match=r"SYMSDE_CPU = 'avx2': give one of baseline, v3, v4"):
        cpu.wanted("avx2", SKYLAKE)
    with pytest.raises(InvalidArgumentError, match=r"lacks .*avx512f.*: give v3 or baseline"):
        cpu.wanted("v4", HASWELL)


def test_folders_in_the_order_to_look_in(monkeypatch):
    monkeypatch.setattr(cpu.platform, "machine", lambda: "x86_64")
    monkeypatch.setattr(cpu, "_flags_here", lambda: HASWELL)
    monkeypatch.delenv("SYMSDE_CPU", raising=False)
    package = Path("p")
    assert [str(folder) for folder in cpu.folders(package)] == ["p/glibc-hwcaps/x86-64-v3", "p"]
    monkeypatch.setenv("SYMSDE_CPU", "baseline")
    assert cpu.folders(package) == [package]
    monkeypatch.setattr(cpu.platform, "machine", lambda: "aarch64")
    assert cpu.folders(package) == [package] and cpu.levels() == []


def test_a_processor_below_all_variants_is_told_so(monkeypatch, tmp_path):
    """A processor below all variants gets an error instead of an illegal instruction; a library outside of wheels
    may be built for such a processor.
    """
    monkeypatch.setattr(cpu.platform, "machine", lambda: "x86_64")
    monkeypatch.setattr(cpu, "_flags_here", lambda: NEHALEM - {"popcnt"})
    monkeypatch.delenv("SYMSDE_CPU", raising=False)
    assert cpu.folders(tmp_path) == [tmp_path]
    (tmp_path / "glibc-hwcaps").mkdir()
    with pytest.raises(LibraryNotFoundError, match=r"lacks popcnt, which .* \(x86-64-v2\)"):
        cpu.folders(tmp_path)
    monkeypatch.setattr(cpu, "_flags_here", lambda: NEHALEM)
    assert cpu.folders(tmp_path) == [tmp_path]
    monkeypatch.setattr(cpu, "_flags_here", set)  # no /proc: flags unknown
    assert cpu.folders(tmp_path) == [tmp_path]


#: Environment variables, and the message; {folder} holds other.so, which is not this library.
BROKEN = {
    "no such file": ("SYMSDE_LIBRARY", "{folder}/no.so", "SYMSDE_LIBRARY = '{folder}/no.so' is not a file: give"),
    "a folder": ("SYMSDE_LIBRARY", "{folder}", "SYMSDE_LIBRARY = '{folder}' is not a file: give"),
    "no library": ("SYMSDE_LIBRARY", "{folder}/symsde", "{folder}/symsde cannot be loaded ("),
    "another library": ("SYMSDE_LIBRARY", "{folder}/other.so", "{folder}/other.so is of another version than this"),
    "no such level": ("SYMSDE_CPU", "avx2", "SYMSDE_CPU = 'avx2': give one of baseline, v3, v4, or unset it"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_command_says_in_one_line_what_is_wrong_with_the_library(case, tmp_path):
    """python -m symsde and pip's script exit with code 2; Python code gets the exception."""
    if sys.platform != "linux" or (case == "no such level" and not cpu.levels()):
        pytest.skip("libraries have other names here, or processors no levels")
    shutil.copy(next(Path(np.__file__).parent.glob("linalg/_umath_linalg*.so")), tmp_path / "other.so")
    script = tmp_path / "symsde"
    script.write_text("import sys\nfrom symsde.cli.command_line import main\nsys.exit(main())\n")
    name, value, sentence = (text.replace("{folder}", str(tmp_path)) for text in BROKEN[case])
    environment = {key: old for key, old in os.environ.items() if key not in ("SYMSDE_LIBRARY", "SYMSDE_CPU")}
    environment[name] = value

    def run(*arguments):
        return subprocess.run(
            [sys.executable, *arguments], env=environment, capture_output=True, text=True, check=False
        )

    for command in (["-m", "symsde", "selftest"], [script, "selftest"], [script, "run", "a.toml"]):
        done = run(*command)
        assert (done.returncode, done.stdout) == (2, ""), done
        assert done.stderr.startswith(f"symsde: {sentence}") and done.stderr.count("\n") == 1, done.stderr
    done = run("-c", "import symsde")
    assert done.returncode == 1 and done.stderr.startswith("Traceback") and sentence in done.stderr


def test_a_package_for_another_processor_says_so(tmp_path):
    """The package's only library is in the folder of its level, which lower processors do not search."""
    if not cpu.levels():
        pytest.skip("processors have no levels here")
    package = tmp_path / "symsde"
    shutil.copytree(Path(cpu.__file__).parents[1], package)
    (package / "glibc-hwcaps" / "x86-64-v9").mkdir(parents=True)
    environment = {key: value for key, value in os.environ.items() if key not in ("SYMSDE_LIBRARY", "SYMSDE_CPU")}
    done = subprocess.run(
        [sys.executable, "-c", "import symsde"],
        env={**environment, "PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1
    assert f"the level x86-64-v9, and this one has the level {cpu.levels()[0]} at most: install it" in done.stderr


def test_a_variant_that_is_not_there_is_an_error():
    """No other library replaces a missing variant; the tree's own build has no variants."""
    environment = {key: value for key, value in os.environ.items() if key != "SYMSDE_LIBRARY"}
    command = [sys.executable, "-c", "import symsde"]
    done = subprocess.run(
        command, env={**environment, "SYMSDE_CPU": "baseline"}, capture_output=True, text=True, check=False
    )
    assert done.returncode == 1 and "LibraryNotFoundError" in done.stderr and "SYMSDE_CPU" not in done.stdout
