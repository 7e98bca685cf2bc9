# SPDX-License-Identifier: BSD-3-Clause
"""Formulas in plain text, such as H_k = sigma (p^2 + q^2)/2, as TeX: for pages, docstrings and comments.

A formula is a longest sequence of words that consist of symbols, operators and numbers. Doubtful words stay plain text.
"""

from __future__ import annotations

import re
from collections.abc import Callable

_NAMES = "alpha|beta|gamma|delta|epsilon|zeta|eta|theta|kappa|lambda|mu|nu|xi|pi|rho|sigma|tau|phi|psi|omega|Omega"
_SYMBOL = rf"(?:(?:{_NAMES})\d?|d[A-Zpqstx]|[aB-HJ-NP-Zb-hj-np-rt-z][1-9ij]?|s\d|[ijk])'*(?![A-Za-z0-9])"
_TOKEN = re.compile(
    r"(?P<number>\d+(?:\.\d+)?(?:e[+-]?\d+)?(?![A-Za-z]))|(?P<function>(?:sin|cos|tan|exp|log|ln|max|min|det|sum)(?![A-Za-z0-9]))"
    rf"|(?P<root>sqrt\()|(?P<symbol>{_SYMBOL})|(?P<script>[_^](?:\{{[^{{}}]*\}}|-?(?:\d+|[A-Za-z0-9]{{1,2}}|{_NAMES})(?!\w)))|(?P<bar>\\?\|)"
    r"|(?P<sign><=|>=|!=|\+-|[-+=<>]|o(?!\w))|(?P<times>[*/]|\.(?=\w))|(?P<open>[(\[{])|(?P<close>[)\]}])|(?P<mark>\.\.|,)"
)
_SIGNS = {"<=": r"\le", ">=": r"\ge", "!=": r"\ne", "+-": r"\pm", "<": r"\lt", ">": r"\gt", "o": r"\circ"}
_SHOWN = _SIGNS | {"*": r"\,", "{": r"\lbrace ", "}": r"\rbrace ", "..": r"\dots ", ".": r"\cdot ", ",": ", "}
_KEPT = re.compile(r"(\*\*|``[^`]+``|`[^`]+`|\$[^$]+\$|\[[^\[\]]*\]\([^)\s]*\)|<[^>\s][^>]*>|\{\w+\}`)")
_BLOCK = re.compile(r"(^```.*?^```[^\n]*$|^\$\$.*?^\$\$[^\n]*$|^(?:#|<!--|!\[|:::| {4}\S)[^\n]*$)", re.M | re.S)
_PART = re.compile(r"(\n(?=\s*\n|\||\s*(?:[-*]|\d+\.) ))")
#: What is a formula only beside more: numbers, names of functions, units, languages, articles.
_DOUBTFUL = re.compile(
    r"(?:\W|\d|e[+-]?\d+|sin|cos|tan|exp|log|ln|max|min|det|sum)*|\W*[A-GIL-SU-Zabcdefgijklmnrsuvxyz]\W*"
)


def typeset(text: str, wrap: Callable[[str], str] = "${}$".format) -> str:
    """A paragraph with its formulas as TeX, each by `wrap`. Code between backquotes, links and TeX stay."""
    return "".join(part if i % 2 else _sentence(part, wrap) for i, part in enumerate(_KEPT.split(text)))


def markdown(page: str) -> str:
    """A page with the formulas of its paragraphs, lists and tables as TeX. Headings, pictures and code stay."""
    blocks = _BLOCK.split(page)
    return "".join(block if i % 2 else "".join(map(_part, _PART.split(block))) for i, block in enumerate(blocks))


def parts(page: str) -> str:
    """A page with the formulas of the parts that programs have written (symsde.studies.pages) as TeX."""
    written = r"(?ms)^(<!-- begin [^\n]*\n)(.*?)(?=^<!-- end )"
    return re.sub(written, lambda found: found[1] + markdown(found[2]), page)


def displayed(lines: list[str]) -> str | None:
    """Lines of formulas, parted by two spaces or more, as one formula; None if they hold anything else.

    A line of several formulas becomes as many lines: side by side, they are wider than a phone.
    """
    rows = []
    for line in lines:
        cells = [typeset(cell) for cell in re.split(r"\s{2,}", line.strip())]
        if (
            not all(re.fullmatch(r"\$[^$]+\$[.,;]?|\(\w+\)|\[WHSB\] [\d()-]+", cell) for cell in cells)
            or "=" not in line
        ):
            return None
        shown = [rf"\text{{{cell}}}" if cell[0] in "([" else cell.replace("$", "") for cell in cells]
        several = sum(cell[0] == "$" for cell in cells) > 1
        rows += shown if several else [r" \qquad ".join(shown)]
    if len(rows) == 1:
        return rows[0]
    aligned = (row.replace(" = ", " &= ", 1) if " = " in row else f"&{row}" for row in rows)
    return r"\begin{aligned} " + r" \\ ".join(aligned) + r" \end{aligned}"


def tex(formula: str) -> str:
    """A formula as TeX; ValueError if a part of it is not known."""
    shown, place, before, bars = "", 0, "begin", 0
    while place < len(formula):
        spaced = formula[place].isspace()
        place += spaced
        found = None if spaced else _TOKEN.match(formula, place)
        if spaced:
            shown += " " * (not shown.endswith(" "))
            continue
        if not found:
            raise ValueError(f"{formula[place:]!r} is not known as a part of a formula")
        kind, word = found.lastgroup, found[0]
        place = found.end()
        if kind == "root":
            inside = _inside(formula, place)
            new, place = rf"\sqrt{{{tex(inside)}}}", place + len(inside) + 1
        elif kind == "bar":
            bars += 1
            kind, new = "open" if bars % 2 else "close", r"\vert "
        else:
            new = _shown(kind, word)
        shown = _joined(shown, before, kind, new)
        before = "open" if kind == "sign" and before in ("begin", "open", "sign") else kind
    return re.sub(r" +", " ", shown).strip()


def _shown(kind: str, word: str) -> str:
    """A token as TeX."""
    if kind == "number":
        factor, _, power = word.partition("e")
        return (rf"{factor}\cdot " * (factor != "1") + f"10^{{{int(power)}}}") if power else word
    if kind == "function":
        return rf"\{word}"
    if kind == "script":
        inside = re.sub(rf"\b(?:{_NAMES})\b", r"\\\g<0> ", word[1:].strip("{}")).strip()
        return f"{word[0]}{inside}" if len(inside) == 1 else f"{word[0]}{{{inside}}}"
    if kind == "symbol":
        name, digit, prime = re.fullmatch(rf"({_NAMES}|d?[A-Za-z])([1-9ij]?)('*)", word).groups()
        name = r"\mathbb E" if name == "E" else rf"\{name}" if re.fullmatch(_NAMES, name) else name
        return name + f"_{digit}" * bool(digit) + prime
    return _SHOWN.get(word, word)


def _joined(shown: str, before: str, kind: str, new: str) -> str:
    """A token put behind what is there: signs between spaces, a thin space between factors that a space parts."""
    parted, shown = shown.endswith(" ") and before not in ("open", "function", "mark", "times"), shown.rstrip()
    apart = (
        shown.endswith(r"\mathbb E") or kind in ("function", "number", "root") or bool(re.match(r"d[A-Zpqstx]", new))
    )
    if kind == "sign":
        if before in ("begin", "open"):
            return shown + new
        return f"{shown} {new}" + " " * (before != "sign")
    if before == "sign":
        return f"{shown} {new}"
    if parted and apart:
        return rf"{shown}\,{new}"
    command = (parted or re.search(r"\\[A-Za-z]+$", shown)) and kind in ("symbol", "open", "number")
    return f"{shown}{' ' * bool(before == 'mark' or (command and not (before == 'function' and kind == 'open')))}{new}"


def _inside(text: str, start: int) -> str:
    """What a bracket that opened just before holds."""
    depth = 1
    for place in range(start, len(text)):
        depth += (text[place] == "(") - (text[place] == ")")
        if not depth:
            return text[start:place]
    raise ValueError(f"{text[start:]!r} does not close its bracket")


def _part(part: str) -> str:
    """A paragraph, an item of a list, or a row of a table: this cell by cell, so that no formula crosses them."""
    if not part.startswith("|"):
        return typeset(part)
    return "|".join(typeset(cell) for cell in re.split(r"(?<!\\)\|", part))


def _sentence(text: str, wrap: Callable[[str], str]) -> str:
    """Text without markup: every sequence of words that are a formula together."""
    shown, row = [], []
    for piece in re.split(r"(\s+)", text):
        word, mark = re.fullmatch(r"(.*?)((?:\.(?!\.)|[,;:])*)", piece, re.S).groups()
        if piece.isspace() or not piece:
            (row or shown).extend(piece and [piece])
        elif not _fits(word, row):
            shown += [*_row(row, wrap), piece]
            row = []
        elif mark == "," and _depth("".join([*row, word])) > 0:
            row.append(piece)
        else:
            row.append(word)
            if mark:
                shown += [*_row(row, wrap), mark]
                row = []
    return "".join([*shown, *_row(row, wrap)])


def _fits(word: str, row: list[str]) -> bool:
    """Whether a word can be a part of a formula that has begun with `row`."""
    said = [x for x in row if not x.isspace()]
    operated = bool(said) and said[-1] in ("=", "+", "-", "*", "/")
    if (word == "o" and not said) or (not operated and (word == "sum" or (word == "a" and said))):
        return False
    if re.fullmatch(r"e\.g|i\.e|[qp]0|--+|\.\.+|", word):
        return False
    while word:
        found = _TOKEN.match(word)
        if not found:
            return False
        word = word[found.end() :]
    return True


def _row(row: list[str], wrap: Callable[[str], str]) -> list[str]:
    """A row of words as a formula, between what does not belong to it."""
    if not row:
        return []
    words, head, tail = list(row), [], []
    while words and _leads(words):
        head.append(words.pop(0))
    while words and (words[-1].isspace() or re.fullmatch(r"[-+=*/<>|.(]+|[oaE]|\\\|", words[-1]) or _stray(words)):
        tail.insert(0, words.pop())
    text = "".join(words)
    if text.endswith(","):
        tail, text = [",", *tail], text[:-1]
    while text.startswith("(") and _depth(text) > 0:
        head, text = [*head, "("], text[1:]
    while text.endswith(")") and _depth(text) < 0:
        tail, text = [")", *tail], text[:-1]
    if _depth(text) or (_DOUBTFUL.fullmatch(text) and "^" not in text):
        return row
    return [*head, wrap(tex(text)), *tail]


def _leads(words: list[str]) -> bool:
    """Whether a row begins with something else: an operator, an article, a number before (h = 1)."""
    rest = re.sub(r"\s+", " ", "".join(words)) + " "
    return bool(re.match(r" |[-+=*/<>|o.]+ |\\\| |a (?!= )|[\d.e-]+ \([^()]*=", rest))


def _stray(words: list[str]) -> bool:
    """Whether a row ends with a number, or that of an equation, without an operator before it."""
    said = [word for word in words if not word.isspace()]
    return len(said) > 1 and bool(re.fullmatch(r"\(?\d[\d.e-]*\)?", said[-1])) and not re.match(r"[-+=*/<>]", said[-2])


def _depth(text: str) -> int:
    return sum(map(text.count, "([{")) - sum(map(text.count, ")]}"))


def linked(text: str, map_page: str) -> str:
    """Equations of the paper as links to their rows of the paper map: [WHSB] (3)-(4) leads to #eq-3 of `map_page`."""
    return re.sub(r"(?<!\[)\[WHSB\] \((\d+)\)(?:-\(\d+\))?", rf"[\g<0>]({map_page}#eq-\g<1>)", text)
