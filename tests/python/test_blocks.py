# SPDX-License-Identifier: BSD-3-Clause
"""Every code block of every page runs, in the order of the page; a block in a language unknown to this suite fails.

Python blocks of a page share their names. A block of text must be the output of an earlier block or of a program on the
page. Scenes are checked and kept under the name in their first line; parts of a scene are completed by BASE. Lines of
shell blocks that call symsde are run; other lines must begin with a word of ELSEWHERE.
"""

import contextlib
import io
import os
import re
import runpy
import shlex
import shutil
import tomllib
from pathlib import Path

import pytest
from symsde.cli import command_line

pytestmark = pytest.mark.optimised

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")), *sorted((ROOT / "docs/method").glob("*.md"))]
FENCE = re.compile(r"^```(\S+)(?: (\S+))?\n(.*?)^```$", re.M | re.S)
#: Output of a page's blocks that is not shown as text, in order.
WORDS = {
    "expect": ("multilevel",),
    "own-model": ("True True True", "E q = -0.758176 +- 0.006346 at t = 10"),
    "reproducibility": ("version",),
    "results": ("outcome",),
    "which-scheme": ("us a path", "others:"),
}
NEEDS = dict.fromkeys(("README", "formulas", "formulas-inside", "own-model", "scenes"), ("sympy",))
NEEDS |= dict.fromkeys(("exit-times", "first-ten-minutes", "project", "results", "scan"), ("sympy", "matplotlib"))
NEEDS |= {
    "expect": ("scipy",),
    "gradients": ("sympy", "scipy"),
    "torch-and-jax": ("torch", "jax"),
    "beams": ("matplotlib",),
}
#: The folder for reading a page: this scene, one part of its run, and the user's own functions.
BASE = """\
[model]
name = "kubo"
[run]
step = 0.02
steps = 100
save_every = 50
paths = 200
seed = 1
q0 = 1.0
p0 = 0.0
[output]
moments = true
paths = [0]
"""
OWN = "def far(q, p):\n    return (abs(q[0]) > 0.9) * 1.0\n"
#: First words of shell lines that other tests run (install_readme, install_consumers), or that every build runs.
ELSEWHERE = (
    "#",
    '. "$HOME/venv',
    "sh jobs/submit.sh",
    "python3 -m venv ",
    "pip install ",
    "cmake ",
    "export ",
    "./bootstrap ",
    ".venv/bin/",
)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A temporary folder, so that nothing is written into the tree."""
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    (tmp_path / "scene.toml").write_text(BASE)
    (tmp_path / "own.py").write_text(OWN)
    for name, value in {"HOME": str(tmp_path), "SLURM_ARRAY_TASK_ID": "1"}.items():
        monkeypatch.setenv(name, value)
    monkeypatch.chdir(tmp_path)
    return tmp_path


class Page:
    """A page while it is read: names of its Python blocks, and the output of each block."""

    def __init__(self, path):
        self.name, self.text = path.stem, path.read_text(encoding="utf-8")
        self.names, self.printed = {}, []

    def read(self):
        """Run every block; returns the kinds of blocks found."""
        kinds = []
        for kind, argument, body in FENCE.findall(self.text):
            getattr(self, "do_" + re.sub(r"\W", "", kind), self.unknown)(body, argument)
            kinds.append(kind)
        return kinds

    def unknown(self, body, _argument):
        pytest.fail(f"{self.name}: no test runs blocks of this kind:\n{body}")

    def keep(self, run, *arguments):
        """Call and keep the output."""
        shown = io.StringIO()
        with contextlib.redirect_stdout(shown):
            run(*arguments)
        self.printed.append(shown.getvalue())

    def do_python(self, body, _argument):
        self.keep(exec, compile(body, self.name, "exec"), self.names)

    def do_text(self, body, _argument):
        shown = f"{self.name} shows\n{body}where its blocks print\n" + "".join(self.printed)
        assert untimed(body) in map(untimed, self.printed), shown

    def do_toml(self, body, _argument):
        given = tomllib.loads(body)
        rest = [table for table in BASE.split("\n[") if table.strip("[").partition("]")[0] not in given]
        name = re.match(r"# (\w+\.toml)\n", body) or ("", "block.toml")
        Path(name[1]).write_text(body + "".join(f"\n[{table.removeprefix('[')}" for table in rest))
        self.command(["check", name[1], "--allow-python"])

    def do_sh(self, body, _argument):
        for line in body.splitlines():
            for task in ("1", "2") if "$SLURM_ARRAY_TASK_ID" in line else ("1",):  # BASE is a run of two shards
                os.environ["SLURM_ARRAY_TASK_ID"] = task
                words = [str(found) for word in shlex.split(line, comments=True) for found in expanded(word)]
                if "symsde" in words and words[0] in ("symsde", "srun", "mpirun"):  # run as one process
                    self.command(words[words.index("symsde") + 1 :])
                else:
                    assert line.startswith(ELSEWHERE), f"{self.name}: no test runs {line}"

    def do_c(self, body, _argument):
        sources = [*(ROOT / "python/symsde/model/formulas").glob("*.h"), ROOT / "include/symsde.h"]
        assert any(body in source.read_text(encoding="utf-8") for source in sources)

    def do_literalinclude(self, _body, argument):
        """A program that ctest runs; if it is a Python program, its output is compared with the page."""
        path = (ROOT / "docs" / argument).resolve()
        runs = (ROOT / "examples/CMakeLists.txt").read_text(encoding="utf-8") + (
            ROOT / "tests/compare_first.py"
        ).read_text(encoding="utf-8")
        assert re.search(rf"\b{path.stem}\b", runs), argument
        if path.name == "first.py":
            self.keep(runpy.run_path, str(path))

    def do_toctree(self, _body, _argument):
        """Nothing to do: the site checks these pages."""

    def command(self, words):
        """A command, which must succeed, also one that only prints help."""
        try:
            code = command_line.main(words)
        except SystemExit as ended:
            code = ended.code
        assert code == 0, f"{self.name}: symsde {shlex.join(words)} ends with {code}"


def untimed(text):
    """The output, without the seconds of a report."""
    return re.sub(r"^seconds .*", "seconds", text, flags=re.M)


def expanded(word):
    """A word of the shell: file patterns as files, variables as values."""
    return sorted(Path().glob(word)) if "*" in word else [os.path.expandvars(word)]


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.stem)
def test_blocks_of_a_page(path, folder):
    page = Page(path)
    for package in NEEDS.get(page.name, ()):
        pytest.importorskip(package)
    kinds = page.read()
    assert kinds or page.name not in {*WORDS, *NEEDS}
    rest = "".join(page.printed)
    for words in WORDS.get(page.name, ()):
        _, found, rest = rest.partition(words)
        assert found, f"{page.name} does not print {words}, or not after the words before"


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.stem)
def test_code_stands_in_fences(path):
    """Indented text outside of fences is not run: only formulas, and shell commands that other tests run, may be
    indented."""
    text = FENCE.sub("", path.read_text(encoding="utf-8"))
    for block in re.findall(r"(?<=\n\n)((?: {4}.*\n)+)", text):
        assert not re.search(r"\bss\.|^ *(symsde|import|from|print)\b|^ *\[\w", block, re.M), block


def test_commands_in_the_text_of_the_readme_run(folder):
    """Every command `symsde ...` between backquotes runs; `symsde paper` has a test of its own."""
    page = Page(ROOT / "README.md")
    commands = [" ".join(words.split()) for words in re.findall(r"`(symsde [^`]+)`", page.text)]
    assert len(commands) >= 2
    for command in commands:
        if command != "symsde paper":
            page.command(shlex.split(command)[1:])


def test_what_is_wrong_with_a_page_is_found(folder):
    """Faults are found: a failing block, other output, an unknown key in a scene, an unknown command, an unknown
    language.
    """
    for block, says in (
        ("```python\nassert False\n```", "AssertionError"),
        ("```python\nprint(1)\n```\n\n```text\n2\n```", "shows"),
        ("```toml\n[run]\nstepp = 1\n```", "ends with 2"),
        ("```sh\nsymsde chekc\n```", "ends with 2"),
        ("```sh\nmake\n```", "no test runs make"),
        ("```julia\n1\n```", "no test runs blocks"),
        ("```c\nint x;\n```", "AssertionError"),
    ):
        (folder / "page.md").write_text(f"{block}\n")
        with pytest.raises((AssertionError, pytest.fail.Exception)) as caught:
            Page(folder / "page.md").read()
        assert says in f"{caught.type.__name__} {caught.value}", block


def test_files_for_slurm_set_up_what_they_need():
    """Each file sets up an environment and uses Slurm's number of threads; test_jobs.py runs the files of `symsde
    slurm`.
    """
    text = (ROOT / "docs/cluster.md").read_text(encoding="utf-8")
    files = [body for kind, _, body in FENCE.findall(text) if "#SBATCH --array" in body]
    assert len(files) == 1
    for body in files:
        assert '. "$HOME/venv/bin/activate"' in body and "#SBATCH --cpus-per-task=" in body
        assert "export SYMSDE_NUM_THREADS=$SLURM_CPUS_PER_TASK\n" in body
    assert "symsde slurm scene.toml --out jobs" in text
