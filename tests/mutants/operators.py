# SPDX-License-Identifier: BSD-3-Clause
"""Faults by rules: small slips in one executable line.

Rules: a sign, a factor (1 % or 2), a bound of a loop, an index, q and p, a term of a sum, < and <=, and for or, a part
of a condition, minimum for maximum, a negation, |h| for h and h for |h|, two arguments of a call, a call or a guarded
exit that is left out. Lines of Fortran are searched as text, with strings and comments masked; lines of Python by their
syntax tree. Declarations, module constants, imports and error messages are left alone."""

import ast
import random
import re
import sys
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

HOMES = {"src": ("*.f90", "*.inc"), "python/symsde": ("*.py",)}
BLANK = re.compile(r"\s|[()]|_wp")
COMPARED = {"<": "<=", "<=": "<", ">": ">=", ">=": ">", "==": "/=", "/=": "=="}
STATE = re.compile(r"(d|h|u|v|f|g|x|y)?(q|p|qq|pp)(s|n|0|_low|_end|_old|_new)?")


class Change(NamedTuple):
    """Columns of one line, and the text that replaces them."""

    line: int  # counted from 1
    begin: int
    end: int
    new: str
    rule: str


def draw(root: Path, seed: int, only: str = "") -> Iterator[tuple[str, str, str, int]]:
    """Yield (file, line, faulty line, line number): every line that a rule can change, once, in random order."""
    files = sorted(path for home, names in HOMES.items() for name in names for path in (root / home).rglob(name))
    chosen = random.Random(seed)
    places = []
    for path in files:
        name = path.relative_to(root).as_posix()
        if name.startswith(only):
            text = path.read_text()
            changes = changes_of(name, text)
            places += [(name, text.splitlines()[line - 1], found) for line, found in sorted(changes.items())]
    chosen.shuffle(places)
    for name, old, found in places:
        rule = chosen.choice(sorted({change.rule for change in found}))
        change = chosen.choice([change for change in found if change.rule == rule])
        yield name, old, old[: change.begin] + change.new + old[change.end :], change.line


def changes_of(name: str, text: str) -> dict[int, list[Change]]:
    """Changes by rules for each line of a file; contracts have none, because the builds under test leave them out."""
    if CONTRACTS.search(name):
        return {}
    return python_changes(text) if name.endswith(".py") else fortran_changes(text)


def makes(name: str, text: str, faulty: str) -> bool:
    """Whether a rule gives this faulty text, up to blanks and redundant brackets."""
    lines, others = text.splitlines(), faulty.splitlines()
    changed = [i for i, pair in enumerate(zip(lines, others, strict=False)) if pair[0] != pair[1]]
    if len(lines) != len(others) or len(changed) != 1:
        return False
    old, new = lines[changed[0]], others[changed[0]]
    made = [old[: x.begin] + x.new + old[x.end :] for x in changes_of(name, text).get(changed[0] + 1, [])]
    return any(BLANK.sub("", one) == BLANK.sub("", new) for one in made)


def by_line(changes: list[Change]) -> dict[int, list[Change]]:
    """Changes line by line."""
    found = defaultdict(list)
    for change in changes:
        found[change.line].append(change)
    return found


def swapped(name: str) -> str:
    """The name with q and p exchanged (hqq for hpp); '' for names that contain neither letter."""
    whole = STATE.fullmatch(name)
    if whole is None:
        return ""
    return name[: whole.start(2)] + whole[2].translate(str.maketrans("qp", "pq")) + name[whole.end(2) :]


# Fortran

OPENS = re.compile(r"^ *((pure|elemental|impure|recursive|module) )*([a-z]+(\([^)]*\))? )?(function|subroutine) \w")
CONTRACTS = re.compile(r"\bcontracts?\.f90$")
CLOSES = re.compile(r"^ *end (function|subroutine)\b")
IDLE = re.compile(
    r"^ *(use|implicit|import|contains|end|else$|case|select|class|type|return|cycle|exit|continue|deallocate|interface"
    r"|procedure|private|public|write|error stop|block$|associate|if \(contracts_are_executed|#|$)"
)
IDLED = re.compile(r"\bcall [\w%]+(\([^&]*\))?$|(?<=\) )(cycle|exit|return)$")  # calls on one line, guarded exits
SAID = re.compile(r"\bcall (raise|add_line|append)\b.*|\b(raise|trim|text)\(.*")  # error messages
RULES = [  # pattern of the place, its replacement, name of the rule
    (r"(?<=[\w)\]] )\+(?= )", "-", "sign"),
    (r"(?<=[\w)\]] )-(?= )", "+", "sign"),
    (r"(?:(?<=[(,*])|(?<=[=,] ))-(?=[a-z(\d])", "", "sign"),
    (r"\b(?!0\.0\b|0\.0_)\d+\.\d*(?:[ed][+-]?\d+)?(?:_wp)?(?!\w)", "(1.01_wp*{0})", "factor"),
    (r"\b(?!0\.0\b|0\.0_)\d+\.\d*(?:[ed][+-]?\d+)?(?:_wp)?(?!\w)", "(2*{0})", "factor"),
    (r"(?<![\w.%)*])\d+\*(?!\*)", "2*{0}", "factor"),
    (r"(?<=/)\d+\b(?![._)/])", "(2*{0})", "factor"),
    (r"(?<![\w%)*/])[a-z][\w%]*(?:\([\w%:, ]*\))?\*(?!\*)", "2*{0}", "factor"),
    (r"(?<![\w%)*/])[a-z][\w%]*(?:\([\w%:, ]*\))?\*(?!\*)", "1.01_wp*{0}", "factor"),
    (r"(?<= )\.and\.(?= )", ".or.", "logic"),
    (r"(?<= )\.or\.(?= )", ".and.", "logic"),
    (r"\.not\. ", "", "negation"),
    (r"\bmin(?=\()", "max", "extreme"),
    (r"\bmax(?=\()", "min", "extreme"),
    (r"\babs(?=\()", "", "modulus"),
    (r"(?<![\w%])(?:\w+%)*(?:h|step|tau)\b(?=\*(?!\*))", "abs({0})", "modulus"),
    (r"(?<=[^*]\*)(?:\w+%)*(?:h|step|tau)\b(?![\w%(*])", "abs({0})", "modulus"),
]


def fortran_changes(text: str) -> dict[int, list[Change]]:
    """Changes for each executable line."""
    counters = set(re.findall(r"\bdo (\w+) = ", text)) | {"lane"}
    rules = [(re.compile(place), new, rule) for place, new, rule in RULES]
    rules += [(re.compile(rf"(?<= ){re.escape(old)}(?= )"), new, "comparison") for old, new in COMPARED.items()]
    one = "|".join(sorted(counters))
    rules += [(re.compile(rf"(?:(?<=[(,])|(?<=, ))(?:{one})(?=[,)])"), f"{{0}} {way} 1", "index") for way in "+-"]
    found = []
    for number, line in executable(text):
        for place, new, rule in rules:
            found += [Change(number, *x.span(), new.format(x[0]), rule) for x in place.finditer(line)]
        found += [
            Change(number, *x.span(), other, "q and p")
            for x in re.finditer(r"(?<![.\w])[a-z]\w*", line)
            if (other := swapped(x[0]))
        ]
        found += [Change(number, *span, "", "term") for span in terms(line)]
        found += [Change(number, *span, "", "condition") for span in conditions(line)]
        found += [Change(number, *x.span(), "continue", "call") for x in IDLED.finditer(line)]
        found += [Change(number, *span, new, "bound") for span, new in bounds(line)]
        found += [Change(number, *span, new, "arguments") for span, new in arguments(line)]
    return by_line(found)


def executable(text: str) -> Iterator[tuple[int, str]]:
    """Number and text of each executable line of procedures, with strings and comments masked."""
    inside, continued, idle, quiet = 0, False, False, False
    for number, line in enumerate(text.splitlines(), 1):
        plain = re.sub(r"'[^']*'|\"[^\"]*\"", lambda x: "~" * len(x[0]), line)
        plain = re.sub(r"!.*", lambda x: " " * len(x[0]), plain)
        if not plain.strip():
            continue
        if not continued:
            head = OPENS.match(plain) is not None
            inside += head - (CLOSES.match(plain) is not None)
            idle = head or inside < 1 or "::" in plain or IDLE.match(plain) is not None
            quiet = False
        if not idle and not quiet:
            if (said := SAID.search(plain)) is not None:
                quiet = True
                plain = plain[: said.start()] + "~" * (len(plain) - said.start())
            yield number, plain
        continued = plain.rstrip().endswith("&") or (quiet and line.rstrip().endswith("&"))


def ends(line: str, begin: int, stops: tuple[str, ...]) -> int:
    """Column where the text from `begin` ends: at a stop on the same bracket level, or where that level closes."""
    depth = 0
    for at in range(begin, len(line)):
        if depth == 0 and (line[at] in ")]&" or line.startswith(stops, at)):
            return at
        depth += (line[at] in "([") - (line[at] in ")]")
    return len(line) if depth == 0 else begin


def terms(line: str) -> Iterator[tuple[int, int]]:
    """Terms of sums, with the signs before them."""
    for sign in re.finditer(r"(?<=[\w)\]]) [+-] ", line):
        end = ends(line, sign.end(), (",", " + ", " - ", " .", " <", " >", " =", " /", ":"))
        if end > sign.end():
            yield sign.start(), len(line[:end].rstrip())


def conditions(line: str) -> Iterator[tuple[int, int]]:
    """Parts of conditions, each with the operator that joins it to its neighbour."""
    for word in re.finditer(r" \.(and|or)\. ", line):
        end = ends(line, word.end(), (",", " .and.", " .or."))
        if end > word.end():
            yield word.start(), len(line[:end].rstrip())
        begin = start_of_part(line, word.start())
        if begin < word.start():
            yield begin, word.end()


def start_of_part(line: str, end: int) -> int:
    """Column where the part of a condition that ends here begins: after a bracket, comma, equals sign or word."""
    depth = 0
    for at in range(end - 1, -1, -1):
        depth += (line[at] in ")]") - (line[at] in "([")
        behind = line[: at + 1]
        if depth < 0 or (depth == 0 and behind.endswith((", ", " = ", ".and. ", ".or. "))):
            return at + 1
    return end


def bounds(line: str) -> Iterator[tuple[tuple[int, int], str]]:
    """First and last values of loops, changed to one too late or too early."""
    for loop in re.finditer(r"\bdo \w+ = ", line):
        comma = ends(line, loop.end(), (",",))
        if comma > loop.end() and line[comma : comma + 2] == ", ":
            yield (comma, comma), " + 1"
            end = len(line[: ends(line, comma + 2, (",",))].rstrip())
            yield (end, end), " - 1"


def arguments(line: str) -> Iterator[tuple[tuple[int, int], str]]:
    """Pairs of neighbouring arguments of a call, exchanged."""
    for call in re.finditer(r"\bcall [\w%]+\(", line):
        places, at = [], call.end()
        while at < len(line):
            end = ends(line, at, (",",))
            places.append((at, end))
            if end >= len(line) or line[end] != ",":
                break
            at = end + 2
        words = [line[begin:end].strip() for begin, end in places]
        for i in range(len(words) - 1):
            if all(re.fullmatch(r"[a-z][\w%]*", word) for word in words[i : i + 2]) and words[i] != words[i + 1]:
                yield (places[i][0], places[i + 1][1]), f"{words[i + 1]}, {words[i]}"


# Python


def python_changes(text: str) -> dict[int, list[Change]]:
    """What can be changed in each line of a function."""
    finder = Finder(text)
    finder.visit(ast.parse(text))
    return by_line(finder.found)


class Finder(ast.NodeVisitor):
    """Visits a module and collects changes inside functions."""

    def __init__(self, text: str) -> None:
        self.lines = text.splitlines()
        self.known = set(re.findall(r"\w+", text))
        self.inside = False
        self.found: list[Change] = []

    def note(self, begin: tuple[int, int], end: tuple[int, int], new: str, rule: str) -> None:
        """Collect a change if it lies on one ASCII line (columns count bytes)."""
        if self.inside and begin[0] == end[0] and self.lines[begin[0] - 1].isascii():
            self.found.append(Change(begin[0], begin[1], end[1], new, rule))

    def replace(self, node: ast.expr, new: str, rule: str) -> None:
        """Replace a node by the text `new`, in which {0} stands for the node's own text."""
        begin, end = span(node)
        if begin[0] == end[0]:
            self.note(begin, end, new.replace("{0}", self.lines[begin[0] - 1][begin[1] : end[1]]), rule)

    def between(self, left: ast.expr, right: ast.expr, words: dict[str, str], rule: str) -> None:
        """Replace the operator between two nodes."""
        begin, end = span(left)[1], span(right)[0]
        if begin[0] == end[0]:
            gap = self.lines[begin[0] - 1][begin[1] : end[1]]
            for old, new in words.items():
                if gap.strip(" ()") == old:
                    at = begin[1] + gap.index(old)
                    self.note((begin[0], at), (begin[0], at + len(old)), new, rule)

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        """Visit the body without its docstring."""
        before, self.inside = self.inside, True
        for one in node.body[ast.get_docstring(node, clean=False) is not None :]:
            self.visit(one)
        self.inside = before

    def visit_Raise(self, node: ast.Raise) -> None:
        """Leave error messages alone."""

    visit_JoinedStr = visit_Import = visit_ImportFrom = visit_Raise  # noqa: N815

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        """Visit the value, not the annotation."""
        if node.value is not None:
            self.visit(node.value)

    def visit_BinOp(self, node: ast.BinOp) -> None:
        """Signs, terms and factors."""
        self.between(node.left, node.right, {"+": "-", "-": "+"}, "sign")
        text = isinstance(node.left, ast.Constant | ast.JoinedStr | ast.List | ast.Tuple)
        if isinstance(node.op, ast.Add | ast.Sub) and not text:
            self.note(span(node.left)[1], span(node)[1], "", "term")
        if isinstance(node.op, ast.Mult) and not text:
            self.replace(node.left, "2 * {0}", "factor")
        self.generic_visit(node)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> None:
        """Drop a negation or a minus."""
        if isinstance(node.op, ast.Not | ast.USub):
            rule = "negation" if isinstance(node.op, ast.Not) else "sign"
            self.note(span(node)[0], span(node.operand)[0], "", rule)
        self.generic_visit(node)

    def visit_Compare(self, node: ast.Compare) -> None:
        """Exchange < and <=, > and >=, == and !=; negate `is` and `in`."""
        words = {old: new.replace("/=", "!=") for old, new in COMPARED.items() if old != "/="} | {"!=": "=="}
        words |= {"is": "is not", "is not": "is", "in": "not in", "not in": "in"}
        for left, right in zip([node.left, *node.comparators], node.comparators, strict=False):
            self.between(left, right, words, "comparison")
        self.generic_visit(node)

    def visit_BoolOp(self, node: ast.BoolOp) -> None:
        """Exchange `and` and `or`; drop one part of the condition."""
        for left, right in zip(node.values, node.values[1:], strict=False):
            self.between(left, right, {"and": "or", "or": "and"}, "logic")
            self.note(span(left)[1], span(right)[1], "", "condition")
        self.note(span(node.values[0])[0], span(node.values[1])[0], "", "condition")
        self.generic_visit(node)

    def visit_Expr(self, node: ast.Expr) -> None:
        """Leave out a call that is a statement."""
        if isinstance(node.value, ast.Call):
            self.replace(node.value, "pass", "call")
        self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> None:
        """Exchange minimum and maximum, drop abs, shift ends of ranges, exchange neighbouring arguments."""
        name = node.func.id if isinstance(node.func, ast.Name) else ""
        if name in {"min", "max"}:
            self.replace(node.func, "max" if name == "min" else "min", "extreme")
        if name == "abs":
            self.replace(node.func, "", "modulus")
        if name == "range":
            self.replace(node.args[min(1, len(node.args) - 1)], "{0} - 1", "bound")
        for left, right in zip(node.args, node.args[1:], strict=False):
            if isinstance(left, ast.Name) and isinstance(right, ast.Name):
                self.note(span(left)[0], span(right)[1], f"{right.id}, {left.id}", "arguments")
        self.generic_visit(node)

    def visit_Subscript(self, node: ast.Subscript) -> None:
        """Increase an integer index by one."""
        for one in ast.walk(node.slice):
            if isinstance(one, ast.Constant) and type(one.value) is int:
                self.replace(one, "{0} + 1", "index")
        self.generic_visit(node)

    def visit_Constant(self, node: ast.Constant) -> None:
        """Change factors, and the strings q and p."""
        if isinstance(node.value, float) and node.value != 0:
            self.replace(node, "(1.01 * {0})", "factor")
            self.replace(node, "(2 * {0})", "factor")
        if node.value in {"q", "p"}:
            self.replace(node, f'"{swapped(node.value)}"', "q and p")

    def visit_Name(self, node: ast.Name) -> None:
        """Exchange q and p; use |h| for h."""
        if swapped(node.id) in self.known:
            self.replace(node, swapped(node.id), "q and p")
        if node.id in {"h", "step"} and isinstance(node.ctx, ast.Load):
            self.replace(node, "abs({0})", "modulus")

    def visit_Attribute(self, node: ast.Attribute) -> None:
        """Exchange q and p; use |h| for h."""
        line, end = span(node)[1]
        if swapped(node.attr) in self.known:
            self.note((line, end - len(node.attr)), (line, end), swapped(node.attr), "q and p")
        if node.attr in {"h", "step"} and isinstance(node.ctx, ast.Load):
            self.replace(node, "abs({0})", "modulus")
        self.generic_visit(node)


def span(node: ast.expr) -> tuple[tuple[int, int], tuple[int, int]]:
    """Line and column of the first and of the last character."""
    return (node.lineno, node.col_offset), (node.end_lineno or 0, node.end_col_offset or 0)


FORTRAN = """
   integer, parameter :: most = 2*n
contains
   subroutine move(q, p)
      real(wp) :: q = 2.0_wp
      do i = 1, n
         if (q(i) < p(i)) call raise(error, 'q and p are ' // text(i + 1)) ! 2*h
         q(i) = t + c*h
      end do
      call kick(a, b, &
                'x')
      if (contracts_are_executed) &
         call require(q, p)
      if (moved(a) .and. b) call sort(a)
   end subroutine move
"""
OF_FORTRAN = {
    6: {"do i = 1 + 1, n", "do i = 1, n - 1"},
    7: {
        "if (q(i) <= p(i))",
        "if (q(i + 1) < p(i))",
        "if (q(i - 1) < p(i))",
        "if (q(i) < p(i + 1))",
        "if (q(i) < p(i - 1))",
    }
    | {"if (p(i) < p(i))", "if (q(i) < q(i))"},
    8: {"q(i + 1) = t + c*h", "q(i - 1) = t + c*h", "p(i) = t + c*h", "q(i) = t - c*h", "q(i) = t"}
    | {"q(i) = t + 2*c*h", "q(i) = t + 1.01_wp*c*h", "q(i) = t + c*abs(h)"},
    10: {"call kick(b, a, &"},
    14: {f"if ({condition}) call sort(a)" for condition in ("moved(a)", "b", "moved(a) .or. b")}
    | {"if (moved(a) .and. b) continue"},
}
PYTHON = """
MOST = 2.0
def move(q, p):
    \"\"\"Say 2.0 * q.\"\"\"
    if not q[0] < p and MOST:
        raise ValueError(f"{q + 1} is too much" + "2.0")
    sort(a)
    return max(a, b) - 0.5
"""
OF_PYTHON = {
    5: {
        "if q[0] < p and MOST:",
        "if not q[0 + 1] < p and MOST:",
        "if not p[0] < p and MOST:",
        "if not q[0] < q and MOST:",
    }
    | {"if not q[0] <= p and MOST:", "if not q[0] < p or MOST:", "if MOST:", "if not q[0] < p:"},
    7: {"pass"},
    8: {"return min(a, b) - 0.5", "return max(b, a) - 0.5", "return max(a, b)", "return max(a, b) + 0.5"}
    | {"return max(a, b) - (1.01 * 0.5)", "return max(a, b) - (2 * 0.5)"},
}


def self_test() -> int:
    """The changes of two small texts must be exactly the listed ones."""
    good = True
    for text, changes, listed in (
        (FORTRAN, fortran_changes(FORTRAN), OF_FORTRAN),
        (PYTHON, python_changes(PYTHON), OF_PYTHON),
    ):
        lines = [line.split(" call raise")[0] for line in text.splitlines()]
        found = {
            number: {lines[number - 1][: x.begin].lstrip() + x.new + lines[number - 1][x.end :] for x in all_of_it}
            for number, all_of_it in changes.items()
        }
        good = good and found == listed
        if found != listed:
            print(f"made\n{found}\ninstead of\n{listed}")
    return int(not good)


if __name__ == "__main__":
    sys.exit(self_test())
