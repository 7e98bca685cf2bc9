# SPDX-License-Identifier: BSD-3-Clause
"""The files, procedures, tests, links, status codes and equations that the documentation names exist.

check_docs.py ROOT        one line per finding; exit 1 where there is one
check_docs.py --self-test plants a violation of every rule and requires that each is found

In the tables of docs/paper-map.md a name in backquotes is a file, or is defined in the file named before it in the same
cell; in the last column names are those of tests."""

import re
import sys
import tempfile
from pathlib import Path

PAGES = ("README.md", "CONTRIBUTING.md", "CHANGELOG.md", "docs/*.md", "docs/method/*.md")
PAPER_MAP, ERRORS, STATUS = "docs/paper-map.md", "docs/errors.md", "src/base/status.f90"
EQUATIONS = {f"({number})" for number in range(1, 93)}
RESULTS = {"Theorem 2.1", "Lemma 2.2", "Theorem 2.3", "Theorem 3.1", "Theorem 3.2", "Example 2.1", "Example 4.1"}
RESULTS |= {"Example 4.2", "Example 4.3", "Figure 4.1", "Figure 4.2"}
FOLDERS = ("src", "tests", "python", "docs", "examples", "bench", "include", "cmake")
FILE = re.compile(r"[\w.-]+(?:/[\w.-]+)+\.\w+")


def prose(text):
    """A page without fenced and indented code blocks."""
    text = re.sub(r"^```.*?^```", "", text, flags=re.S | re.M)
    return re.sub(r"(?<=\n\n)(?: {4}.*\n+)+", "", text)


def anchors(text):
    """Anchors of a page: those that GitHub makes from headings, and explicit anchors."""
    found = set(re.findall(r'<a id="([^"]+)">', text))
    for heading in re.findall(r"^#+ (.*)$", prose(text), re.M):
        found.add(re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-"))
    return found


def links(root, page, text):
    """Findings: relative links and images that lead to no file, or to no heading in it."""
    for target in re.findall(r"\]\(([^)\s]+)\)", prose(text)):
        if re.match(r"[a-z]+:", target):
            continue
        name, _, anchor = target.partition("#")
        file = (root / page).parent / name if name else root / page
        if not file.exists():
            yield f"links to {target}, which does not exist"
        elif anchor and anchor not in anchors(file.read_text(encoding="utf-8")):
            yield f"links to {target}, but there is no such heading"


def printed(root, page, text):
    """Findings: links whose text is an equation, [(3)-(4)](paper-map.md#eq-3), that lead to another equation's row."""
    for shown, anchor in re.findall(r"\[([^\[\]]*)\]\([^)\s]*paper-map\.md#eq-(\d+)\)", prose(text)):
        row = re.search(rf'<a id="eq-{anchor}"></a>(.*?) \|', (root / PAPER_MAP).read_text(encoding="utf-8"))
        if row and not set(numbers(shown)) <= set(numbers(row[1])):
            yield f"shows {shown}, and links to the row of {row[1]}"


def equations(texts):
    """Findings: labels of formulas given twice, and references without a label."""
    given = [label for text in texts.values() for label in re.findall(r"^\$\$ \(([\w-]+)\)$", text, re.M)]
    for label in sorted({label for label in given if given.count(label) > 1}):
        yield f"docs: formulas share the label {label}"
    for page, text in texts.items():
        for label in re.findall(r"\{eq\}`([^`]+)`", text):
            if label not in given:
                yield f"{page}: refers to the formula {label}, which does not exist"


def letters(row):
    """Approximate width of a row of TeX in letters: a script counts half, a relation or operator double."""
    row = re.sub(r"\\[,;! ]|\\[Bb]ig[lr]|\\(?:text|mathrm|mathtt|operatorname|phantom)", "", row)
    row = re.sub(r"\\[td]?frac(\d|\{[^{}]*\})(\d|\{[^{}]*\})", lambda found: max(found[1], found[2], key=len), row)
    row = re.sub(r"[_^](?:\{([^{}]*)\}|\\\w+|.)", lambda found: "'" * len(re.sub(r"\\\w+", "x", found[1] or "x")), row)
    row = re.sub(r"\\(?:le|ge|circ|cdot|quad|sum|int|sqrt)\b|[=+<>-]", "xx", row.replace(r"\qquad", "xxx"))
    row = re.sub(r"[{}\s]", "", re.sub(r"\\\w+|\\.", "x", row))
    return len(row) - len(re.findall(r"[.,()|\[\]']", row)) / 2


def wide(text):
    """Findings: displayed formulas with a row of more than 31 letters, too wide for a phone of 375 points."""
    for formula in re.findall(r"^\$\$\s*(.*?)\$\$", text, re.M | re.S):
        if "pmatrix" in formula:
            continue
        split = re.split(r"\\\\", re.sub(r"\\(?:begin|end)\{\w+\}", "", formula))
        cells = [[letters(cell) for cell in row.split("&")] for row in split if row.strip()]
        count = max(map(len, cells))
        if sum(map(max, zip(*(row for row in cells if len(row) == count), strict=True))) > 31:
            yield f"has a formula too wide for a phone, set it in several lines: {' '.join(formula.split())[:60]}"


def comments(text):
    """Findings: lines that begin with %, which the site would drop as comments."""
    for line in re.findall(r"^\s*(%.*)$", prose(text), re.M):
        yield f"has a line that the site leaves out: {line[:40]}"


def paths(root, text):
    """Findings: files named in the text that do not exist."""
    for name in re.findall(r"`([^`\n]+)`", prose(text)):
        if FILE.fullmatch(name) and name.split("/")[0] in FOLDERS and not (root / name).exists():
            yield f"names {name}, which does not exist"


def rows(text):
    """The cells of each row of every table, without the headers."""
    for line in text.splitlines():
        if line.startswith("|") and not re.fullmatch(r"[|\s:-]+", line):
            yield [cell.strip() for cell in line.strip().strip("|").split("|")]


def defines(file, text, name, as_test):
    """Whether a source defines a procedure, a type or (as_test) a test of this name."""
    name = re.escape(name)
    if file.suffix == ".py":
        return bool(re.search(rf"^\s*(def|class) {name}\b" if not as_test else rf"^def {name}\(", text, re.M))
    if file.suffix == ".pf":
        return bool(re.search(rf"@test\s*\n\s*subroutine {name}\b", text))
    if file.suffix == ".f90":
        procedure = rf"^(?!\s*end\b)[^!'\"\n]*\b(subroutine|function)\s+{name}\b"
        return bool(re.search(rf"{procedure}|^\s*type\b(?!\s*\()[^\n]*::\s*{name}\s*$", text, re.M | re.I))
    return bool(re.search(rf"\b{name}\b", text))


def cell_names(root, cell, as_test):
    """Findings of one cell of the map, and the number of tests that it names."""
    file, count = None, 0
    findings = []
    for name in re.findall(r"`([^`]+)`", cell):
        if "/" in name:
            file = root / name
            if not file.exists():
                findings.append(f"names {name}, which does not exist")
                file = None
        elif file is None:
            findings.append(f"names {name} without a file before it")
        elif not defines(file, file.read_text(encoding="utf-8"), name, as_test):
            what = "a test" if as_test else "anything"
            findings.append(f"{file.relative_to(root).as_posix()} does not define {what} called {name}")
        else:
            count += 1
    return findings, count


def numbers(cell):
    """Equations that the first cell of a row covers: (3), (3)-(5)."""
    for first, last in re.findall(r"\((\d+)\)(?:-\((\d+)\))?", cell):
        yield from range(int(first), int(last or first) + 1)


def paper_map(root):
    """Findings in the map: equations without a row, names that do not exist, rows without a test unless background."""
    text = (root / PAPER_MAP).read_text(encoding="utf-8")
    seen = set()
    for cells in rows(text):
        if cells[0] == "paper":
            continue
        seen |= {f"({number})" for number in numbers(cells[0])}
        seen |= {result for result in RESULTS if result in cells[0]}
        if len(cells) != 4:
            yield f"row {cells[0]} has {len(cells)} cells and not 4"
            continue
        for column, cell in enumerate(cells[1:], 1):
            findings, count = cell_names(root, cell, as_test=column == 3)
            yield from findings
            if column == 3 and not count and not cell.startswith("background"):
                yield f"row {cells[0]} names no test and is not background"
    for missing in sorted((EQUATIONS | RESULTS) - seen, key=lambda item: (len(item), item)):
        yield f"has no row for {missing}"


def status_codes(root):
    """Findings: names, codes and texts in docs/errors.md that differ from the list in the sources."""
    source = (root / STATUS).read_text(encoding="utf-8")
    codes = dict(re.findall(r"parameter :: (\w+) = (-?\d+)", source))
    texts = dict(re.findall(r"case \((\w+)\); text = '([^']*)'", source))
    listed = {}
    for cells in rows((root / ERRORS).read_text(encoding="utf-8")):
        if re.fullmatch(r"-?\d+", cells[0]):
            listed[cells[1].strip("`")] = cells[0], cells[2]
    for name, code in codes.items():
        wanted = code, texts.get(name, "")
        if listed.pop(name, None) != wanted:
            yield f"does not list {name} with code {code} and text '{wanted[1]}'"
    for name in listed:
        yield f"lists {name}, which {STATUS} does not have"


def findings(root):
    """Every finding, as a line of text."""
    files = (file for pattern in PAGES for file in sorted(root.glob(pattern)))
    texts = {file.relative_to(root).as_posix(): file.read_text(encoding="utf-8") for file in files}
    for page, text in texts.items():
        rules = (links(root, page, text), printed(root, page, text), paths(root, text), wide(text), comments(text))
        for rule in rules:
            yield from (f"{page}: {finding}" for finding in rule)
    yield from equations(texts)
    yield from (f"{PAPER_MAP}: {finding}" for finding in paper_map(root))
    yield from (f"{ERRORS}: {finding}" for finding in status_codes(root))


EVERY = f'<a id="eq-1"></a>(1)-(92), {", ".join(RESULTS)}'
ROW = f"| {EVERY} | `src/a.f90` `solve` `kind` | remark | `tests/test_a.pf` `test_it` |\n"
GOOD = {
    "README.md": "# Title\n\n[map](docs/paper-map.md), `src/a.f90`, `src/<area>/x.f90`, [here](#title)\n",
    "docs/method/a.md": "[(2)-(3)](../paper-map.md#eq-1), {eq}`eq-a`\n\n$$\nx\n$$ (eq-a)\n\n$$\ny\n$$ (eq-b)\n",
    "docs/paper-map.md": f"| paper | where | remark | test |\n|---|---|---|---|\n{ROW}",
    "docs/errors.md": "| code | name | text |\n|---|---|---|\n| -1 | `bad` | no good |\n",
    "src/a.f90": "type, extends(other) :: kind\nend type kind\npure subroutine solve(x)\nend subroutine solve\n",
    "tests/test_a.pf": "@test\nsubroutine test_it()\nend subroutine test_it\nsubroutine helper()\nend subroutine\n",
    STATUS: "integer, parameter :: bad = -1\ncase (bad); text = 'no good'\n",
}
PLANTED = (
    ("README.md", "docs/paper-map.md", "docs/map.md", "links to docs/map.md"),
    ("README.md", "#title", "#titel", "no such heading"),
    ("README.md", "`src/a.f90`", "`src/b.f90`", "names src/b.f90"),
    ("docs/method/a.md", "#eq-1", "#eq-2", "no such heading"),
    ("docs/method/a.md", "[(2)-(3)]", "[(2)-(93)]", "shows (2)-(93)"),
    ("docs/method/a.md", "{eq}`eq-a`", "{eq}`eq-c`", "refers to the formula eq-c"),
    ("docs/method/a.md", "(eq-b)", "(eq-a)", "share the label eq-a"),
    ("docs/method/a.md", "\ny\n", "\n" + r"Q_n = q_n + q,\qquad " * 4 + "\n", "too wide for a phone"),
    ("README.md", "[here]", "15\n% [here]", "the site leaves out"),
    ("docs/paper-map.md", "(1)-(92)", "(1)-(91)", "no row for (92)"),
    ("docs/paper-map.md", "Lemma 2.2", "Lemma 2.1", "no row for Lemma 2.2"),
    ("docs/paper-map.md", "`src/a.f90`", "`src/b.f90`", "names src/b.f90"),
    ("docs/paper-map.md", "`solve`", "`dissolve`", "does not define anything called dissolve"),
    ("docs/paper-map.md", "`src/a.f90` `solve`", "`solve`", "names solve without a file"),
    ("docs/paper-map.md", "`test_it`", "`helper`", "does not define a test called helper"),
    ("docs/paper-map.md", " `test_it`", "", "names no test"),
    ("docs/paper-map.md", "| remark ", "", "has 3 cells"),
    ("docs/errors.md", "-1", "-2", "does not list bad"),
    ("docs/errors.md", "no good", "good", "does not list bad"),
    ("docs/errors.md", "`bad`", "`worse`", "lists worse"),
)


def write(root, page, text):
    """Write a file, and its folders."""
    (root / page).parent.mkdir(parents=True, exist_ok=True)
    (root / page).write_text(text, encoding="utf-8")


def self_test():
    """A sound tree gives no finding, and every planted violation is found by its own rule."""
    failures = []
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        for page, text in GOOD.items():
            write(root, page, text)
        found = list(findings(root))
        if found:
            failures.append(f"a sound tree gives {found}")
        for page, old, new, wanted in PLANTED:
            write(root, page, GOOD[page].replace(old, new))
            found = list(findings(root))
            if not any(wanted in line for line in found):
                failures.append(f"planted '{wanted}', found {found}")
            write(root, page, GOOD[page])
    return failures


def main():
    """Run the check or its self-test."""
    found = self_test() if sys.argv[1] == "--self-test" else list(findings(Path(sys.argv[1])))
    print("\n".join(found) if found else "nothing to report")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
