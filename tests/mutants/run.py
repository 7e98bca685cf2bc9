# SPDX-License-Identifier: BSD-3-Clause
"""Plant faults, one at a time, and report whether the suites notice them.

run.py BUILD [--check | --sample] [--only WORD] [--part K/N] [--named] [--jobs N] [--keep FILE] [--table FILE]
run.py BUILD --random N --seed S [--short T] [--only WORD] [--part K/N] [--jobs N] [--keep FILE] [--table FILE]

A fault (mutant) is an entry of tests/mutants/*.toml: file, old text, new text, and the test that should catch it; or a
rule (operators.py) makes it in a line picked by the seed: the same seed gives the same faults in the same tree. The
mutated file alone is compiled with the build's command (for a body, .inc, the files that include it), and linked with
the build's other objects into a library, which the test programs load instead of theirs. Faults of the Python package,
or of headers, are planted in a copy of them. Neither the tree nor the build is touched.

    --check       only look whether every entry still fits the sources, and is none that rules make
    --sample      the entries with sample = true
    --random N    N faults made by rules; faults that do not compile or change no instruction are drawn again
    --short T     suites of under T seconds judge these faults, instead of three minutes: a first look
    --only WORD   the entries whose file or text holds the word; of faults made by rules, files that begin so
    --part K/N    the K-th of N parts, for several processes or machines; the verdicts kept by all can be joined
    --named       run no other test than the one that the entry names: a quick look
    --keep FILE   write each verdict to FILE at once, and reuse verdicts from an earlier run, so that a stopped run
                  continues; a fault whose file has changed since is judged again
    --table FILE  write the result as a page: a row for each folder, and the survivors with their reasons

The named test runs first, then, where it passes, every other suite that is not long, the quickest first. Faults made by
rules are judged by suites of under three minutes, by the times of the last run of ctest: first suites that caught most
faults of the folder for their time, then suites named after the file, that use its module, that share a word with its
name, that use its folder, then all others. The exit code is not 0 if an entry does not fit, a survivor has no reason, a
reason has no survivor, or under 95 % are caught (90 % of faults made by rules)."""

import argparse
import ast
import contextlib
import gzip
import hashlib
import importlib
import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from collections import Counter, defaultdict
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass, field
from itertools import islice
from pathlib import Path
from threading import Lock

import operators

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "tests" / "house"))
bodies = importlib.import_module("bodies").bodies
LABELS = {"unit", "verification", "capi", "python"}
LONG = {"test_order", "test_beyond_one", "check_funit"}  # too long, or not about the library
LINKED = {"python_test_export"}  # links its programs to the installed library, not to the faulty one
PATIENCE = 1800  # seconds, after which a hanging test counts as failed
HANGS = 20  # a test that takes this many times its usual duration counts as hanging
SHORT = 180  # seconds: the longest suite that judges faults made by rules
WANTED, WANTED_BY_RULES = 0.95, 0.9


class MisfitError(Exception):
    """An entry that does not fit the sources, the build or the tests."""


@dataclass(frozen=True)
class Mutant:
    """One fault."""

    file: str
    old: str
    new: str
    test: str = ""
    survives: str = ""  # why no suite can catch the fault
    sample: bool = False
    line: int = 0  # line number of a fault made by a rule, whose old text is that line

    @property
    def label(self) -> str:
        """The file, and the old and new text, on one line."""
        old, new = (" ".join(text.split()) for text in (self.old, self.new))
        return f"{self.file}:{f'{self.line}:' if self.line else ''} {old} -> {new or 'nothing'}"

    @property
    def folder(self) -> str:
        """The folder that the fault is counted in."""
        return "/".join(self.file.split("/")[:-1][: 2 if self.file.startswith("src/") else 3])

    def apply(self) -> str:
        """The text of the file with the fault; the old text must occur exactly once."""
        source = (ROOT / self.file).read_text()
        if self.line:
            lines = source.splitlines()
            return "\n".join([*lines[: self.line - 1], self.new, *lines[self.line :]]) + "\n"
        if (times := source.count(self.old)) != 1 or self.old == self.new:
            raise MisfitError(f"{self.label}\n   the old text is there {times} times, not once")
        return source.replace(self.old, self.new)

    def is_made_by_rules(self) -> bool:
        """Whether a rule makes the same fault."""
        return operators.makes(self.file, (ROOT / self.file).read_text(), self.apply())

    @property
    def key(self) -> str:
        """Identifies a verdict: a hash of the faulty file and the named test."""
        return hashlib.sha256(f"{self.file}\n{self.test}\n{self.apply()}".encode()).hexdigest()[:16]


@dataclass(frozen=True)
class Verdict:
    """The verdict: the test that noticed the fault, or none; or why the entry does not fit."""

    key: str
    label: str
    caught_by: str
    wrong: str
    seconds: float


@dataclass
class Test:
    """A test as ctest runs it."""

    command: list[str]
    environment: dict[str, str]
    folder: str
    patience: float = PATIENCE  # seconds
    sound: bool | None = None  # whether it passes without a fault; None before it was tried
    lock: Lock = field(default_factory=Lock)

    def passes(self, environment: dict[str, str]) -> bool:
        """Whether the test passes with these further environment variables; a test that hangs fails."""
        process = subprocess.Popen(
            self.command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            cwd=self.folder,
            env=os.environ | {"PYTEST_ADDOPTS": "-x"} | self.environment | environment,
            process_group=0,
        )
        try:
            return process.wait(self.patience) == 0
        except subprocess.TimeoutExpired:
            return False
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)  # with its child processes
            process.wait()

    def is_sound(self, environment: dict[str, str]) -> bool:
        """Whether the test passes without a fault, in the environment of the right library; tried once, and its
        duration then limits all later runs.
        """
        with self.lock:
            if self.sound is None:
                start = time.monotonic()
                self.sound = self.passes(environment)
                self.patience = patience_with(time.monotonic() - start)
        return self.sound


class Build:
    """The build tree: its tests, and how a file of the library is compiled and linked."""

    def __init__(self, folder: Path, short: float = SHORT) -> None:
        self.folder, self.short = folder.resolve(), short
        self.catches: Counter[tuple[str, str]] = Counter()  # number of faults caught, by folder of the fault and suite
        found = json.loads(self.ask("ctest", "--show-only=json-v1"))["tests"]
        self.cost = self.costs()
        found.sort(key=lambda entry: self.cost[entry["name"]])
        found = [entry for entry in found if is_suite(entry)]
        self.names = {entry["name"] for entry in found}  # also tests that are not built
        self.tests = {entry["name"]: read_test(entry) for entry in found if "command" in entry}
        for name, test in self.tests.items():
            if self.cost[name]:  # a test without a recorded time may take long
                test.patience = patience_with(self.cost[name])
        entries = json.loads(self.ask("ninja", "-t", "compdb"))
        self.commands = {entry["output"]: entry["command"] for entry in entries}
        self.library = next(name for name in self.commands if name.startswith("libsymsde.so"))

    def ask(self, *command: str) -> str:
        """Output of a tool that runs in this build tree."""
        return subprocess.run(command, check=True, capture_output=True, text=True, cwd=self.folder).stdout

    def costs(self) -> dict[str, float]:
        """Seconds that each test took when ctest ran it last; tests that never ran are missing."""
        kept = self.folder / "Testing" / "Temporary" / "CTestCostData.txt"
        lines = kept.read_text().split("---")[0].splitlines() if kept.exists() else []
        return defaultdict(float, {line.split()[0]: float(line.split()[2]) for line in lines if line})

    def order(self, mutant: Mutant, named: bool) -> list[str]:
        """Names of the suites that judge a fault, in the order in which they run."""
        if mutant.test:
            spared = {mutant.test} | (set() if mutant.file.startswith("python/") else LINKED)
            return [mutant.test, *(name for name in self.tests if name not in spared and not named)]
        of_python = mutant.file.startswith("python/")
        place = Path(mutant.file).relative_to("python/symsde" if of_python else "src").with_suffix("")
        stem, parts = place.name.strip("_"), place.parts[:-1]
        beside = re.compile("[._]".join(["symsde", *parts, ""]))
        module = re.compile(rf"{beside.pattern}{stem}\b")
        others = {one.name for one in (ROOT / mutant.file).parents[len(parts)].rglob("*") if one.is_dir()} - {*parts}

        def distance(name: str) -> tuple[float, int, float]:
            source = next((ROOT / "tests").rglob(f"{name.removeprefix('python_')}.[p]*"), None)
            text, words = source.read_text() if source is not None else "", set(name.split("_")) - {"test"}
            near = [stem in name, module.search(text), words & {*parts, *stem.split("_")}, beside.search(text)]
            near += [not words & others, True]  # suites without a word in common with folder or file come last
            caught_in_a_second = self.catches[mutant.folder, name] / (1 + self.cost[name])
            return -caught_in_a_second, [bool(one) for one in near].index(True), self.cost[name]

        fit = {name for name in self.tests if self.cost[name] < self.short}
        fit = {name for name in fit if name.startswith("python_")} if of_python else fit - LINKED
        return sorted(fit, key=distance)

    def make_library(self, mutant: Mutant, text: str, scratch: Path) -> Path:
        """Build a library with this text for the file; for a body (.inc), compile all files that include it."""
        changed, replaced, same = ROOT / mutant.file, {}, True
        for source in included_by(changed) if changed.suffix == ".inc" else [changed]:
            target = f"src/CMakeFiles/symsde.dir/{source.relative_to(ROOT / 'src')}.o"
            place = scratch / source.relative_to(ROOT)
            made = place.with_suffix(".o")
            words = shlex.split(self.commands[target])
            modules = next((word[2:] for word in words if word.startswith("-J")), "")
            words = [f"-J{scratch}" if word.startswith("-J") else word for word in words if word != "-fpreprocessed"]
            words[words.index("-c") + 1] = str(place)
            words[words.index("-o") + 1] = str(made)
            words += [f"-I{modules}", "-cpp"] if modules else []
            for one in {source, changed, *bodies(source)}:  # include lines name bodies relative to their source
                copy = scratch / one.relative_to(ROOT)
                copy.parent.mkdir(parents=True, exist_ok=True)
                copy.write_text(one.read_text())
            if mutant.line:
                words += ["-Wconversion", "-Werror"]  # refuses an index times 1.01
                self.build(mutant, words)
                sound = made.read_bytes()
            (scratch / changed.relative_to(ROOT)).write_text(text)
            self.build(mutant, words)
            same = same and mutant.line > 0 and made.read_bytes() == sound
            replaced[target] = str(made)
            for module in scratch.glob("*.mod"):
                if interface_of(module) != interface_of(self.folder / modules / module.name):
                    raise MisfitError(
                        f"{mutant.label}\n   changes what its module offers: choose one inside of a procedure"
                    )
        if same:
            raise MisfitError(f"{mutant.label}\n   changes no instruction")
        library = scratch / "libsymsde.so"
        words = [word for word in shlex.split(self.commands[self.library]) if word not in {":", "&&"}]
        words = [replaced.get(word, word) for word in words]
        words[words.index("-o") + 1] = str(library)
        self.build(mutant, words)
        return library

    def build(self, mutant: Mutant, words: list[str]) -> None:
        """Run a command of the build."""
        done = subprocess.run(words, check=False, capture_output=True, text=True, cwd=self.folder)
        if done.returncode != 0:
            raise MisfitError(f"{mutant.label}\n   does not build:\n{done.stderr[-2000:]}")


def patience_with(seconds: float) -> float:
    """Time limit of a test that takes so many seconds without a fault."""
    return min(PATIENCE, 60 + HANGS * seconds)


def properties_of(entry: dict) -> dict:
    """Properties of a test in ctest's list."""
    return {item["name"]: item["value"] for item in entry.get("properties", [])}


def is_suite(entry: dict) -> bool:
    """Whether the test is one of the suites that judge faults."""
    properties = properties_of(entry)
    judges = LABELS & set(properties.get("LABELS", [])) and not properties.get("WILL_FAIL")
    return bool(judges) and entry["name"] not in LONG


def read_test(entry: dict) -> Test:
    """A test of ctest's list."""
    properties = properties_of(entry)
    environment = dict(item.split("=", 1) for item in properties.get("ENVIRONMENT", []))
    return Test(entry["command"], environment, properties.get("WORKING_DIRECTORY", "."))


def included_by(body: Path) -> list[Path]:
    """Sources that include a body."""
    return [one for one in sorted((ROOT / "src").rglob("*.f90")) if body in bodies(one)]


def interface_of(module: Path) -> bytes:
    """A module file without its first line, which names the source, and without lines that callers do not rely on."""
    return gzip.decompress(module.read_bytes()).split(b"\n", 1)[1].replace(b" IMPLICIT_PURE", b"")


def read_mutants() -> list[Mutant]:
    """All entries, file after file."""
    entries = []
    for name in sorted(Path(__file__).parent.glob("*.toml")):
        entries += [Mutant(**entry) for entry in tomllib.loads(name.read_text()).get("mutant", [])]
    return entries


def plant(mutant: Mutant, build: Build, scratch: Path) -> dict[str, str]:
    """Make the faulty library or package; the variables that put it before the tests."""
    text = mutant.apply()
    if mutant.file.endswith(".py"):
        try:
            same = ast.dump(ast.parse(text)) == ast.dump(ast.parse((ROOT / mutant.file).read_text()))
        except SyntaxError as error:
            raise MisfitError(f"{mutant.label}\n   {error}") from error
        if same:  # exchanging the arguments of get(x, x) changes nothing
            raise MisfitError(f"{mutant.label}\n   changes nothing")
    if mutant.file.startswith("python/"):
        shutil.copytree(ROOT / "python", scratch / "python", ignore=shutil.ignore_patterns("__pycache__"))
        (scratch / mutant.file).write_text(text)
        return {"PYTHONPATH": str(scratch / "python")}
    if mutant.file.startswith("include/"):
        shutil.copytree(ROOT / "include", scratch / "include")
        (scratch / mutant.file).write_text(text)
        return {"SYMSDE_INCLUDE": str(scratch / "include")}
    return put_first(build.make_library(mutant, text, scratch))


def put_first(library: Path) -> dict[str, str]:
    """The variables with which programs find this library already loaded under the library's name; Python loads it by
    its path. A test that fails with the right library put first would catch every fault."""
    return {"LD_PRELOAD": str(library), "SYMSDE_LIBRARY": str(library), "PYTHONPATH": str(ROOT / "python")}


def judge(mutant: Mutant, build: Build, named: bool) -> Verdict:
    """Plant the fault and run the suites, or the named test alone."""
    start = time.monotonic()
    caught_by, wrong = "", ""
    right = put_first(build.folder / "libsymsde.so")
    with tempfile.TemporaryDirectory(prefix="mutant-") as scratch:
        try:
            environment = plant(mutant, build, Path(scratch))
            for name in build.order(mutant, named):
                test = build.tests[name]
                if name == mutant.test and not test.is_sound(right):
                    raise MisfitError(f"{mutant.label}\n   {name} fails without a fault")
                if not test.passes(environment) and test.is_sound(right):
                    caught_by = name
                    break
        except MisfitError as error:
            wrong = str(error)
    return Verdict(mutant.key, mutant.label, caught_by, wrong, round(time.monotonic() - start, 1))


def judge_all(mutants: list[Mutant], build: Build, jobs: int, keep: Path | None, named: bool) -> dict[Mutant, Verdict]:
    """Kept verdicts that still hold, and verdicts on the other faults, each written to the file at once."""
    kept = {}
    if keep is not None and keep.exists():
        known = [Verdict(**json.loads(line)) for line in keep.read_text().splitlines()]
        kept = {verdict.key: verdict for verdict in known if not verdict.wrong}
    verdicts = {mutant: kept[mutant.key] for mutant in mutants if mutant.key in kept}
    left = [mutant for mutant in mutants if mutant not in verdicts]
    build.catches.update((mutant.folder, verdict.caught_by) for mutant, verdict in verdicts.items())
    print(f"{len(verdicts)} verdicts are kept, {len(left)} faults are judged", flush=True)
    with ThreadPoolExecutor(jobs) as pool:
        waiting = {pool.submit(judge, mutant, build, named): mutant for mutant in left}
        for done in as_completed(waiting):
            mutant, verdict = waiting[done], done.result()
            verdicts[mutant] = verdict
            build.catches[mutant.folder, verdict.caught_by] += 1
            print(spoken(mutant, verdict), flush=True)
            if keep is not None and (verdict.caught_by or not named):
                with keep.open("a") as record:
                    record.write(json.dumps(asdict(verdict)) + "\n")
    return verdicts


def judge_random(options: argparse.Namespace, build: Build) -> dict[Mutant, Verdict]:
    """Verdicts on as many faults by rules as asked for, or as exist."""
    drawn = (
        Mutant(file, old, new, line=line) for file, old, new, line in operators.draw(ROOT, options.seed, options.only)
    )
    first, count = map(int, options.part.split("/"))
    mine = islice(drawn, first - 1, None, count)
    wanted, verdicts = len(range(first - 1, options.random, count)), {}
    while more := list(islice(mine, wanted - len(verdicts))):
        found = judge_all(more, build, options.jobs, options.keep, named=False)
        verdicts |= {mutant: verdict for mutant, verdict in found.items() if not verdict.wrong}
    return verdicts


def check(mutants: list[Mutant], build: Build) -> int:
    """Entries that do not fit, each with its reason."""
    wrong = 0
    for mutant in mutants:
        try:
            mutant.apply()
            if mutant.test not in build.names:
                raise MisfitError(f"{mutant.label}\n   there is no suite {mutant.test}, or it is a long one")
            if not (mutant.sample or mutant.survives) and mutant.is_made_by_rules():
                raise MisfitError(f"{mutant.label}\n   a rule of operators.py makes it: leave it out")
        except MisfitError as error:
            wrong += 1
            print(error)
    print(f"{len(mutants) - wrong} entries fit, {wrong} do not")
    return wrong


def spoken(mutant: Mutant, verdict: Verdict) -> str:
    """The verdict on one or two lines."""
    if verdict.wrong:
        return f"DOES NOT FIT {verdict.wrong}" if not mutant.line else f"drawn again: {mutant.label}"
    if not verdict.caught_by:
        reason = mutant.survives or "no reason given"
        return f"SURVIVED ({verdict.seconds:.0f} s) {mutant.label}\n   {reason}"
    note = "" if verdict.caught_by == mutant.test or mutant.line else f", not by {mutant.test}"
    note += ", though a reason says that it cannot be" if mutant.survives else ""
    return f"caught ({verdict.seconds:.0f} s) by {verdict.caught_by}{note}: {mutant.label}"


def as_table(verdicts: dict[Mutant, Verdict]) -> str:
    """A table: by folder, how many faults were caught, how many by the named test; then the faults that survived."""
    rows: dict[str, list[tuple[Mutant, Verdict]]] = defaultdict(list)
    for mutant, verdict in verdicts.items():
        rows[mutant.folder].append((mutant, verdict))
    lines = ["| folder | faults | caught | share | by the test named |", "|---|---|---|---|---|"]
    for folder, found in [*sorted(rows.items()), ("all", list(verdicts.items()))]:
        named = sum(verdict.caught_by == mutant.test != "" for mutant, verdict in found)
        caught = sum(bool(verdict.caught_by) for _, verdict in found)
        lines.append(f"| {folder} | {len(found)} | {caught} | {100 * caught / len(found):.0f} % | {named} |")
    lines += ["", "| not caught | why |", "|---|---|"]
    for mutant, verdict in sorted(verdicts.items(), key=lambda pair: pair[0].label):
        if not verdict.caught_by:
            label = mutant.label.replace("|", "\\|")
            lines.append(f"| `{label}` | {mutant.survives or 'no reason given'} |")
    return "\n".join(lines) + "\n"


def main() -> int:
    """Judge the entries that the arguments select."""
    parser = argparse.ArgumentParser(description="Plant faults and see whether the suites notice.")
    parser.add_argument("build", type=Path)
    parser.add_argument("--check", action="store_true")
    parser.add_argument("--sample", action="store_true")
    parser.add_argument("--random", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--short", type=float, default=SHORT)
    parser.add_argument("--only", default="")
    parser.add_argument("--part", default="1/1")
    parser.add_argument("--named", action="store_true")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--table", type=Path)
    options = parser.parse_args()
    build = Build(options.build, options.short)
    if options.random:
        verdicts, wanted = judge_random(options, build), WANTED_BY_RULES
        print(as_table(verdicts))
    else:
        mutants = [mutant for mutant in read_mutants() if options.only in mutant.label]
        mutants = [mutant for mutant in mutants if mutant.sample or not options.sample]
        first, count = map(int, options.part.split("/"))
        mutants = mutants[first - 1 :: count]
        if check(mutants, build) > 0 or not mutants:
            return 1
        if options.check:
            return 0
        verdicts, wanted = judge_all(mutants, build, options.jobs, options.keep, options.named), WANTED
    caught = sum(bool(verdict.caught_by) for verdict in verdicts.values())
    if options.table is not None:
        options.table.write_text(as_table(verdicts))
    print(f"{caught} caught, {len(verdicts) - caught} not, of {len(verdicts)}")
    explained = all(
        not verdict.wrong and bool(verdict.caught_by) != bool(mutant.survives) for mutant, verdict in verdicts.items()
    )
    return int(caught < wanted * len(verdicts) or not (explained or options.random))


if __name__ == "__main__":
    sys.exit(main())
