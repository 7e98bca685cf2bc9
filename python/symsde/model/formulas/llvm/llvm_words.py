# SPDX-License-Identifier: BSD-3-Clause
"""Words of generated C: comments left out, macros expanded, conditions decided."""

from __future__ import annotations

import re
from dataclasses import dataclass

_WORDS = re.compile(
    r"0[xX][0-9a-fA-F]*\.?[0-9a-fA-F]*(?:[pP][+-]?\d+)?[uUlL]*|(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?[uUlL]*"
    r"|[A-Za-z_]\w*|->|<<=|>>=|<<|>>|\+\+|--|&&|\|\||[-+*/%&|^=!<>]=|[^\s\w]"
)
IVDEP, UNROLL = "__ivdep", "__unroll"  #: what stands for pragmas before a loop


@dataclass(frozen=True)
class _Macro:
    parameters: tuple[str, ...] | None  #: None = it takes none, not even parentheses
    body: tuple[str, ...]


def words_of(source: str, defined: tuple[str, ...]) -> list[str]:
    """All words of a C text, with these names defined."""
    text = re.sub(r"/\*.*?\*/", " ", source, flags=re.DOTALL).replace("\\\n", " ")
    macros = {name: _Macro(None, ("1",)) for name in defined}
    result: list[str] = []
    waiting: list[str] = []
    kept = [True]  # in nested conditions
    for line in text.splitlines():
        begin = re.match(r"\s*#\s*(\w+)\s*(.*)", line)
        if begin is None:
            waiting += _WORDS.findall(line) if all(kept) else []
            continue
        what, rest = begin[1], begin[2].strip()
        if what == "pragma":
            about = [IVDEP] if "ivdep" in rest else [UNROLL] if re.search(r"unroll (?!1$)", rest) else []
            waiting += about if all(kept) else []
            continue
        result += _expanded(waiting, macros)
        waiting = []
        if what == "if":
            kept.append(_decided(rest, macros))
        elif what == "else":
            kept[-1] = not kept[-1]
        elif what == "endif":
            kept.pop()
        elif what == "define" and all(kept):
            name, parameters, body = re.match(r"(\w+)(\([^)]*\))?\s*(.*)", rest).groups()
            names = None if parameters is None else tuple(x.strip() for x in parameters[1:-1].split(","))
            macros[name] = _Macro(names, tuple(_WORDS.findall(body)))
    return result + _expanded(waiting, macros)


def _decided(condition: str, macros: dict[str, _Macro]) -> bool:
    """Whether a condition of #if holds: names that are defined, numbers that are equal, or not zero."""
    terms = []
    for term in condition.split("&&"):
        if name := re.fullmatch(r"\s*defined (\w+)\s*", term):
            terms.append(name[1] in macros)
        else:
            left, *right = (_expanded(_WORDS.findall(x), macros) for x in term.split("=="))
            terms.append([left] == right if right else left != ["0"])
    return all(terms)


def _expanded(words: list[str], macros: dict[str, _Macro], hidden: frozenset[str] = frozenset()) -> list[str]:
    """Words with macros replaced; none of them in itself."""
    result: list[str] = []
    k = 0
    while k < len(words):
        word = words[k]
        k += 1
        macro = macros.get(word) if word not in hidden else None
        if macro is None or (macro.parameters is not None and words[k : k + 1] != ["("]):
            result.append(word)
            continue
        body = list(macro.body)
        if macro.parameters is not None:
            k, arguments = _arguments(words, k)
            given = {x: _expanded(y, macros, hidden) for x, y in zip(macro.parameters, arguments, strict=True)}
            body = [y for x in body for y in given.get(x, [x])]
        result += _expanded(body, macros, hidden | {word})
    return result


def _arguments(words: list[str], k: int) -> tuple[int, list[list[str]]]:
    """Arguments of a macro from its parenthesis at k; the place after them."""
    depth, found = 0, [[]]
    while True:
        word = words[k]
        depth += (word in "([{") - (word in ")]}")
        k += 1
        if depth == 0:
            return k, found
        if word == "," and depth == 1:
            found.append([])
        elif not (word == "(" and depth == 1 and found == [[]]):
            found[-1].append(word)
