# SPDX-License-Identifier: BSD-3-Clause
"""symsde selftest and symsde cite: every check passes here, and fails if its part of the library is wrong."""

import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import symsde as ss
from symsde.cli import cite, command_line, selftest
from symsde.errors import SymsdeError
from symsde.native import library

NAMES = [check.__name__ for check in selftest.CHECKS]


def test_all_is_well_and_quick(capsys):
    assert ss.selftest()
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[:-1]] == ["ok"] * 8
    found = re.fullmatch(r"8 of 8 checks passed in ([\d.]+) s", lines[-1])
    assert found and float(found[1]) < 60  # ten seconds on a quiet machine, more on a busy one
    assert str(library.found()) in lines[7]


def _shifted(by):
    return lambda function: lambda *args, **options: function(*args, **options) + by


def _other_options(**wrong):
    """The function called with options other than the given ones."""
    return lambda function: lambda *args, **options: function(*args, **{**options, **wrong})


def _drifting(function):
    """A fault: midpoint rotates slightly too far, as a wrong library would."""

    def wrong(*args, **options):
        q, p = function(*args, **options)
        return q * (1 + 1e-12), p

    return wrong


def _as_heun(function):
    return lambda model, *args, **options: function(model, "heun", *args[1:], **options)


def _without_the_step(function):
    """A fault: a resumed run repeats the noise of its first steps."""
    return lambda *args, **options: function(*args, **{**options, "first_step": 0})


def _by_threads(function):
    """A fault: the last digit depends on the number of threads."""

    def wrong(*args, threads=None, **options):
        run = function(*args, threads=threads, **options)
        if threads == 4:
            run.q[1, 0, 2999] = np.nextafter(run.q[1, 0, 2999], 2.0)
        return run

    return wrong


FAULTS = {
    "noise": ("increments", _other_options(seed=20260102)),
    "one_step": ("step", _drifting),
    "structure": ("diagnose", None),
    "order": ("convergence", _as_heun),
    "mean": ("moments", _other_options(step=0.0205)),
    "resume": ("simulate", _without_the_step),
    "threads": ("simulate", _by_threads),
    "variant": ("_library", None),
}


@pytest.mark.parametrize("name", NAMES)
def test_a_planted_fault_fails_its_check(name, monkeypatch, tmp_path, capsys):
    """Each planted fault fails its own check and no other check, so that a user knows where to look."""
    what, fault = FAULTS[name]
    if name == "structure":
        found = selftest.diagnose.symplecticity
        monkeypatch.setattr(selftest.diagnose, "symplecticity", lambda *args: found(*args) + 1e-11)
    elif name == "order":
        found = selftest.convergence
        monkeypatch.setattr(
            selftest, "convergence", lambda *args, **options: replace(found(*args, **options), order=0.5)
        )
    elif name == "variant":
        better = tmp_path / "glibc-hwcaps" / "x86-64-v3"
        better.mkdir(parents=True)
        monkeypatch.delenv("SYMSDE_LIBRARY", raising=False)
        monkeypatch.setattr(library, "package", lambda: tmp_path)
        monkeypatch.setattr(library, "candidates", lambda: [better / "libsymsde.so", tmp_path / "libsymsde.so"])
    else:
        monkeypatch.setattr(selftest, what, fault(getattr(selftest, what)))
    bad = [check.name.replace(" ", "_") for check in selftest.checks() if not check.good]
    assert bad == [name]
    assert not ss.selftest()
    assert "7 of 8 checks passed" in capsys.readouterr().out
    assert command_line.main(["selftest"]) == 1


def test_a_check_that_cannot_be_made_has_failed(monkeypatch):
    def refused(*_args, **_options):
        raise SymsdeError("no such model")

    monkeypatch.setattr(selftest, "increments", refused)
    first = next(selftest.checks())
    assert (first.name, first.found, first.good) == ("noise", "no such model", False)


def test_the_verb(capsys):
    assert command_line.main(["selftest"]) == 0
    assert "8 of 8" in capsys.readouterr().out


def test_the_command_line_needs_numpy_alone(tmp_path):
    """A fresh environment without sympy, xarray, numba, matplotlib: scenes run, and save the files they can."""
    hide = "import sys; sys.modules.update(dict.fromkeys(sys.argv[1].split(',')))\n"
    names = "sympy,symengine,xarray,netCDF4,numba,matplotlib,tqdm,scipy,pandas"
    verb = [
        sys.executable,
        "-c",
        f"{hide}from symsde.cli import command_line as cli; sys.exit(cli.main(sys.argv[2:]))",
        names,
    ]
    text = subprocess.run([*verb, "template", "kubo"], check=True, capture_output=True, text=True).stdout
    (tmp_path / "k.toml").write_text(text.replace("steps = 5000", "steps = 500"))
    run = [*verb, "run", tmp_path / "k.toml", "--out", tmp_path / "k"]
    done = subprocess.run(run, check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert {"moments.csv", "run.npz"} <= {file.name for file in (tmp_path / "k").iterdir()}
    assert subprocess.run([*verb, "selftest"], check=False, capture_output=True).returncode == 0


def test_every_source_of_the_catalogue_is_cited():
    """Each 'Names year' of a reference has an entry with these names and this year."""
    seen = set()
    for name in ss.schemes.names():
        reference = ss.schemes.get(name).info.reference
        text = cite.cite(name)
        for names, year in re.findall(r"([A-Z][\w']+(?:, [A-Z][\w']+)*) ((?:19|20)\d\d)", reference):
            seen.add((names, year))
            entries = [entry for entry in text.split("\n@") if f"year = {{{year}}}" in entry]
            assert any(all(author in entry for author in names.split(", ")) for entry in entries), (name, names, year)
    assert len(seen) == 9  # Holm, Tyranowski 2018, ..: fewer would mean a wrong pattern


def test_citations_are_sound_bibtex():
    """Braces match, keys are unique, and only entries for this scheme are included."""
    for name in [None, *ss.schemes.names()]:
        text = cite.cite(name)
        depths = np.cumsum([{"{": 1, "}": -1}.get(letter, 0) for letter in text])
        assert depths[-1] == 0 and depths.min() >= 0
        keys = re.findall(r"^@\w+\{(\w+),$", text, re.M)
        assert len(keys) == len(set(keys)) == text.count("@")
        assert keys[:2] == ["symsde", "WHSB"]
    assert "Castell" not in cite.cite("midpoint") and "MaDingDing2012" not in cite.cite("lobatto3")
    assert f"version = {{{ss.__version__}}}" in cite.cite()


def test_an_entry_without_a_title_says_so():
    entries = [entry for source in cite._SOURCES.values() for entry in source.split("\n@")]
    without = [entry for entry in entries if not re.search(r"^  title = \{\S", entry, re.M)]
    assert len(entries) == 11 and len(without) == 2
    assert all("the title could not be confirmed and is left out}" in entry for entry in without)


def test_the_paper_is_cited_as_in_the_citation_file():
    text = (Path(__file__).resolve().parents[2] / "CITATION.cff").read_text(encoding="utf-8")
    entry = cite.cite()
    for key, field in (("volume", "volume"), ("issue", "number"), ("year", "year")):
        assert f"{field} = {{{re.search(rf'{key}: (.+)', text)[1]}}}" in entry
    assert "pages = {586--602}" in entry and 'start: "586"' in text and 'end: "602"' in text


def test_the_verb_cite(capsys):
    assert command_line.main(["cite", "--scheme", "stormer_verlet"]) == 0
    said = capsys.readouterr().out
    assert said.startswith("% stormer_verlet: Lobatto") and "10.1007/s10543-018-0720-2" in said
    assert command_line.main(["cite", "--scheme", "midpiont"]) == 2
    assert "midpiont" in capsys.readouterr().err
