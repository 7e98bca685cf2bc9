# SPDX-License-Identifier: BSD-3-Clause
"""The LAPACK in use: dense systems of up to 160 unknowns do not depend on it, reports and folders name it for larger
systems, and its BLAS starts no threads.

LAPACKs are those of Debian's folders on this machine, and of folders that SYMSDE_LAPACKS names: NAME=DIR:DIR,NAME=.. .
Each is tried in a process of its own whose loader finds it first, after a preloaded library that counts new threads.
"""

import functools
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import symsde as ss
from symsde.batch import manifest
from symsde.batch import scene as scenes
from symsde.cli import command_line

SCENE = """
[model]
name = "fpu_chain"
n = {n}
[run]
scheme = "gauss2"
general = true
step = 0.1
steps = 2
paths = 4
q0 = 0.1
p0 = 0.2
"""
UNKNOWNS = {"small": 40, "large": 41}  # degrees of freedom; two stages have 160 and 164 unknowns

COUNT = """
#define _GNU_SOURCE
#include <dlfcn.h>
#include <pthread.h>
static int made;
int threads_made(void) { return made; }
int pthread_create(pthread_t *thread, const pthread_attr_t *how, void *(*run)(void *), void *with) {
   int (*real)(pthread_t *, const pthread_attr_t *, void *(*)(void *), void *);
   *(void **)&real = dlsym(RTLD_NEXT, "pthread_create");
   made++;
   return real(thread, how, run, with);
}
"""

RUNS = """
import ctypes, hashlib, json
import symsde as ss
count = ctypes.CDLL(None).threads_made
found = {"name": ss.build_info()["lapack"]}
for what, n in (("small", 40), ("large", 41)):
    before = count()
    run = ss.simulate(ss.models.fpu_chain(n=n), scheme="gauss2", general=True, step=0.1, steps=2, paths=4, threads=1,
                      q0=0.1, p0=0.2)
    found[what] = {"bits": hashlib.sha256(run.q.tobytes() + run.p.tobytes()).hexdigest(), "lapack": run.report.lapack,
                   "solves": run.report.counters["lapack_solves"], "threads": count() - before, "end": run.q[-1, 0, 0]}
print(json.dumps(found))
"""


def folders():
    """Folders of libraries by name, beginning with the machine's own."""
    found = {"the machine": ""}
    for place in sorted(Path("/usr/lib").glob("*-linux-gnu/*")):
        if place.name.startswith(("openblas-", "blis-", "atlas")) and (place / "libblas.so.3").exists():
            found[place.name] = str(place)
    for given in filter(None, os.environ.get("SYMSDE_LAPACKS", "").split(",")):
        name, _, places = given.partition("=")
        found[name] = places
    return found


@pytest.fixture(scope="module")
def counter(tmp_path_factory):
    """The library that counts threads."""
    if shutil.which("cc") is None or not sys.platform.startswith("linux"):
        pytest.skip("there is no C compiler, or no Linux")
    place = tmp_path_factory.mktemp("count")
    (place / "count.c").write_text(COUNT)
    subprocess.run(["cc", "-shared", "-fPIC", "-o", place / "count.so", place / "count.c", "-ldl"], check=True)
    return place / "count.so"


@functools.cache
def runs(counter, places):
    """Results of a process with the libraries in these folders and OMP_NUM_THREADS=4."""
    given = {key: x for key, x in os.environ.items() if not key.startswith(("OPENBLAS", "MKL_NUM", "BLIS"))}
    given |= {"OMP_NUM_THREADS": "4", "LD_PRELOAD": str(counter)}
    given |= {"LD_LIBRARY_PATH": places} if places else {}
    done = subprocess.run([sys.executable, "-c", RUNS], env=given, capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


@pytest.mark.parametrize("name", folders())
def test_every_lapack_that_is_there(name, counter):
    there = folders()
    here, found = runs(counter, there["the machine"]), runs(counter, there[name])
    assert found["small"]["bits"] == here["small"]["bits"]
    assert found["small"]["lapack"] == "" and found["small"]["solves"] == 0
    assert found["small"]["threads"] == found["large"]["threads"] == 0, "of a BLAS that has more than one thread"
    assert found["large"]["end"] == pytest.approx(here["large"]["end"], rel=1e-13)
    assert found["large"]["lapack"] == (found["name"] if found["large"]["solves"] else "")
    assert "/" not in found["name"] and "unknown" not in found["name"]
    wanted = {"openblas": "OpenBLAS ", "blis": "BLIS", "atlas": "ATLAS ", "mkl": "MKL ", "netlib": "netlib "}
    for word, vendor in wanted.items():
        assert not name.startswith(word) or vendor in found["name"], found["name"]


def test_a_report_names_whose_lapack_solved():
    for what, n in UNKNOWNS.items():
        run = ss.simulate(
            ss.models.fpu_chain(n=n), scheme="gauss2", general=True, step=0.1, steps=1, paths=1, q0=0.1, p0=0.2
        )
        counters = run.report.counters
        assert counters["pivoted_solves"] == counters["solves"] > 0
        if what == "small":
            assert run.report.lapack == "" and counters["lapack_solves"] == 0
            assert "LAPACK" not in str(run.report)
        elif counters["lapack_solves"]:  # if no BLAS was used, no LAPACK is named
            assert counters["lapack_solves"] == counters["solves"]
            assert run.report.lapack == ss.build_info()["lapack"]
            assert f"LAPACK     {run.report.lapack}" in str(run.report)


@pytest.fixture
def parts(tmp_path):
    """Two parts of the large scene; the LAPACK's name is imitated."""
    (tmp_path / "scene.toml").write_text(SCENE.format(n=41) + "[output]\npaths = [0, 1, 2, 3]\n")
    for i in (1, 2):
        given = [tmp_path / "scene.toml", "--out", tmp_path / f"part{i}", "--shard", f"{i}/2", "--quiet"]
        assert command_line.main(["run", *map(str, given)]) == 0
    return tmp_path


def edit(folder, **changes):
    """Edit a folder as if another machine had written it."""
    path = folder / "manifest.json"
    content = json.loads(path.read_text())
    path.write_text(json.dumps({**content, "numerics": {**content["numerics"], **changes}}))


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"lapack": "MKL 1"}, "numerics.lapack = 'MKL 1' there, "),
        ({"arithmetic": "by hand"}, "numerics.arithmetic = 'by hand' there, "),
    ],
)
def test_another_lapack_or_rounding_is_refused(changes, sentence, parts, capsys):
    edit(parts / "part1", **changes)
    given = ["run", str(parts / "scene.toml"), "--out", str(parts / "part1"), "--quiet"]
    assert command_line.main(given) == command_line.BAD_INPUT
    shown = capsys.readouterr().err
    assert "part1 holds another run: " + sentence in shown and "give another folder with --out" in shown
    given = ["merge", str(parts / "part1"), str(parts / "part2"), "--out", str(parts / "out"), "--quiet"]
    assert command_line.main(given) == command_line.BAD_INPUT
    assert "hold parts of different runs: " + sentence in capsys.readouterr().err


@pytest.mark.parametrize("what", UNKNOWNS)
def test_a_folder_names_it_where_it_solves(what, tmp_path):
    (tmp_path / "scene.toml").write_text(SCENE.format(n=UNKNOWNS[what]))
    found = manifest.of_scene(scenes.load(str(tmp_path / "scene.toml")), 256)["numerics"]
    build = ss.build_info()
    assert found["arithmetic"] == build["arithmetic"] in ("fused", "rounded twice")
    assert found.get("lapack", build["lapack"]) == build["lapack"]
    assert what == "large" or "lapack" not in found
