# SPDX-License-Identifier: BSD-3-Clause
"""Formulas as text: arithmetic, known names, functions of one argument, and nothing else.

Text may come from a stranger's file, so none of it is ever executed: Python's parser makes a tree, and only nodes of
the kinds below are read. Sizes are bounded before anything is computed, and constants are folded in floating point if
exact constants would become long.
"""

from __future__ import annotations

import ast
import contextlib
import keyword
import math
import re
import unicodedata
from collections.abc import Iterable, Mapping
from typing import Any

from ...errors import InvalidArgumentError
from ...native import checks
from ...native.files import optional
from . import kinks
from .graph import BESSEL, FUNCTIONS, MAX_ORDER, SCALAR

MAX_CHARACTERS = 20_000
MAX_NODES = 4_000
MAX_DEPTH = 40
MAX_INTEGER = 2**53
MAX_EXPONENT = 32
MAX_FACTORS = 20  #: most factors of one product: the cost of its second derivatives grows as the cube of their number
_ADDITIVE, _MULTIPLICATIVE = (ast.Add, ast.Sub), (ast.Mult, ast.Div)
_WORD, _HIDDEN = re.compile(rf"\b(?:{'|'.join(keyword.kwlist)})\b"), "word_of_python_"
_CONSTANTS = {
    "loggamma": lambda x: math.lgamma(x) if x > 0 else math.nan,
    "sech": lambda x: 1 / math.cosh(x),
    "csch": lambda x: 1 / math.sinh(x),
    "coth": lambda x: 1 / math.tanh(x),
}
_ONE = (*FUNCTIONS, *SCALAR, *kinks.REWRITTEN, *kinks.ONE)
_TWO = ("atan2", "Mod", *BESSEL)
_SEVERAL = (*_TWO, *kinks.MANY)
_ALL = (*_ONE, *_SEVERAL, "Piecewise")
_COMPARED = {ast.Lt: "Lt", ast.LtE: "Le", ast.Gt: "Gt", ast.GtE: "Ge"}
_JOINED = {ast.BitAnd: "And", ast.BitOr: "Or"}
_RESERVED = frozenset({*FUNCTIONS, "pi"})


class FormulaTextError(InvalidArgumentError):
    """The text is no formula; the message says which part is wrong."""


def parse(text: str, names: Mapping[str, Any], reader: Reader | None = None) -> Any:
    """The expression of sympy that a text describes, in the symbols that its names stand for."""
    if len(text) > MAX_CHARACTERS:
        raise FormulaTextError(f"it has {len(text)} characters, allowed are {MAX_CHARACTERS}")
    try:
        tree = _tree(text, names)
    except (SyntaxError, ValueError) as error:
        reason = getattr(error, "msg", None) or str(error)
        raise FormulaTextError(f"it is not written as a formula ({reason}); write as in p**2/2 + cos(q)") from None
    except (RecursionError, MemoryError):
        raise FormulaTextError("its parentheses are nested too deeply") from None
    count = sum(1 for _ in _bounded(tree))
    if count > MAX_NODES:
        raise FormulaTextError(f"it has more than {MAX_NODES} names, numbers and operations")
    return (reader or Reader(names)).read(tree.body, 0)


def _tree(text: str, names: Iterable[str]) -> ast.Expression:
    """Python's tree of a text. Keywords of Python, such as lambda, are treated as names if they are known names, or if
    Python cannot parse the text otherwise."""
    known = set(keyword.kwlist).intersection(names)
    try:
        tree = ast.parse(_WORD.sub(lambda word: _HIDDEN * (word[0] in known) + word[0], text.strip()), mode="eval")
    except SyntaxError:
        if len(known) == len(keyword.kwlist) or not _WORD.search(text):
            raise
        with contextlib.suppress(SyntaxError):
            return _tree(text, keyword.kwlist)
        raise
    for node in ast.walk(tree):
        if isinstance(node, ast.Name):
            node.id = node.id.removeprefix(_HIDDEN)
    return tree


def names_in(text: str) -> set[str]:
    """The names in a text; empty if the text is no formula."""
    try:
        tree = _tree(text, keyword.kwlist) if len(text) <= MAX_CHARACTERS else ast.Constant(0)
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return set()
    return {node.id for node in _bounded(tree) if isinstance(node, ast.Name)}


def _bounded(tree: ast.AST):
    """Nodes of a tree, up to one more than MAX_NODES, so that a caller sees if there are too many."""
    waiting, count = [tree], 0
    while waiting and count <= 2 * MAX_NODES:
        node = waiting.pop()
        if not isinstance(node, ast.operator | ast.unaryop | ast.expr_context):
            count += 1
            yield node
        waiting.extend(ast.iter_child_nodes(node))


class Reader:
    """Converts Python's tree to an expression."""

    def __init__(self, names: Mapping[str, Any]):
        """`names`: the meaning of the names in the text."""
        self.sympy = optional("sympy", "sympy")
        self.names = names

    def read(self, node: ast.AST, depth: int) -> Any:
        """The expression of a node."""
        if depth > MAX_DEPTH:
            raise FormulaTextError(f"it is nested more than {MAX_DEPTH} deep")
        if isinstance(node, ast.Constant):
            return self._number(node.value)
        if isinstance(node, ast.Name):
            return self._named(node.id)
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.UAdd):
            value = self.read(node.operand, depth + 1)
            return -value if isinstance(node.op, ast.USub) else value
        if isinstance(node, ast.BinOp):
            return self._operation(node, depth)
        if isinstance(node, ast.Call):
            return self._called(node, depth)
        raise FormulaTextError(f"it holds {_what(node)}; there are numbers, names, + - * / ** and functions")

    def _number(self, value: Any) -> Any:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise FormulaTextError(f"it holds {checks.shown(value)}, which is no real number")
        if isinstance(value, int) and abs(value) > MAX_INTEGER:
            raise FormulaTextError("it holds a whole number above 2**53: write it as 1e20")
        if not math.isfinite(value):
            raise FormulaTextError("it holds a number that is too large: allowed is up to 1.8e308")
        return self.sympy.Integer(value) if isinstance(value, int) else self._float(value)

    def _float(self, value: float) -> Any:
        """A floating-point number, exactly; integer values become integers."""
        return (
            self.sympy.Integer(int(value))
            if value == int(value) and abs(value) < MAX_INTEGER
            else self.sympy.Float(value)
        )

    def _named(self, name: str) -> Any:
        if name in self.names:
            return self.names[name]
        if name == "pi":
            return self.sympy.pi
        if name in FUNCTIONS:
            raise FormulaTextError(f"the function {name} has no argument: write {name}(q)")
        near = checks.nearest(name, self.names)
        raise FormulaTextError(
            f"it holds {name}, which is not given: there are {near}; name it in q or p, or give its value in params"
        )

    def _operation(self, node: ast.BinOp, depth: int) -> Any:
        """Read a sum or product. A chain of any length counts as one level of depth, because it is written without
        brackets.
        """
        if isinstance(node.op, ast.Pow):
            return self._power(self.read(node.left, depth + 1), self.read(node.right, depth + 1))
        kinds = next((k for k in (_ADDITIVE, _MULTIPLICATIVE) if isinstance(node.op, k)), None)
        if isinstance(node.op, ast.BitXor):
            raise FormulaTextError("it holds ^: a power is written **")
        if kinds is None:
            raise FormulaTextError("it holds an operation other than + - * / **")
        chain = []
        first: ast.AST = node
        while isinstance(first, ast.BinOp) and isinstance(first.op, kinds):
            chain.append((first.op, first.right))
            first = first.left
        if kinds is _MULTIPLICATIVE and len(chain) >= MAX_FACTORS:
            raise FormulaTextError(f"it holds a product of {len(chain) + 1} factors, allowed are {MAX_FACTORS}")
        parts = [self.read(first, depth + 1)]
        for operation, operand in reversed(chain):
            value = self.read(operand, depth + 1)
            if isinstance(operation, ast.Sub):
                value = -value
            elif isinstance(operation, ast.Div):
                value = self._power(value, self.sympy.Integer(-1))
            parts.append(value)
        numbers = [x for x in parts if x.is_number]
        others = [x for x in parts if not x.is_number]
        constant = self._folded(numbers, kinds is _ADDITIVE)
        return (self.sympy.Add if kinds is _ADDITIVE else self.sympy.Mul)(constant, *others)

    def _folded(self, numbers: list[Any], additive: bool) -> Any:
        """Fold a sum or product of constants; exact constants stay exact while they are short."""
        result = self.sympy.Integer(0 if additive else 1)
        for x in numbers:
            result = self._small(result + x if additive else result * x)
        return result

    def _small(self, x: Any) -> Any:
        """A constant, converted to floating point if it has many digits."""
        if x.is_Rational and max(abs(x.p), x.q) <= MAX_INTEGER:
            return x
        value = self._real(x)
        return x if not x.is_Rational and x.is_number and not x.is_Float and x.count_ops() < 20 else self._float(value)

    def _real(self, x: Any) -> float:
        try:
            value = float(x)
        except (TypeError, ValueError, OverflowError):
            value = math.nan
        if not math.isfinite(value):
            raise FormulaTextError("it holds a constant that is not a finite real number")
        return value

    def _power(self, base: Any, exponent: Any) -> Any:
        if base.is_number and exponent.is_number:
            return self._constant_power(base, exponent)
        if exponent.is_number and abs(self._real(exponent)) > MAX_EXPONENT:
            raise FormulaTextError(
                f"it holds the exponent {self._real(exponent):g}: allowed is up to {MAX_EXPONENT} in size"
            )
        return base**exponent

    def _constant_power(self, base: Any, exponent: Any) -> Any:
        try:
            value = self._real(base) ** self._real(exponent)
        except (OverflowError, ZeroDivisionError):
            value = math.nan
        if isinstance(value, complex) or not math.isfinite(value):
            raise FormulaTextError("it holds a power or quotient of constants that is not a finite real number")
        if exponent.is_Integer and base.is_Rational and abs(exponent) <= MAX_EXPONENT:
            return self._small(base**exponent)
        return self._float(value)

    def _called(self, node: ast.Call, depth: int) -> Any:
        if not isinstance(node.func, ast.Name):
            raise FormulaTextError("it calls something that is no function of one argument")
        name = "Abs" if node.func.id == "abs" else node.func.id
        if name == "Piecewise":
            return self._cases(node, depth)
        if name in _SEVERAL:
            return self._of_several(name, node, depth)
        if name.lower() == "sum":
            raise FormulaTextError(
                f"it calls {name}: sums over sites are written Sum(formula, i), beside n, the number of sites"
            )
        if name not in _ONE:
            raise FormulaTextError(
                f"it calls {name}, which is no function here: there are {checks.nearest(name, _ALL)}"
            )
        if len(node.args) != 1 or node.keywords:
            raise FormulaTextError(f"it gives {name} {len(node.args) + len(node.keywords)} arguments: it takes one")
        argument = self.read(node.args[0], depth + 1)
        if not argument.is_number or (name not in FUNCTIONS and name not in SCALAR):
            return getattr(self.sympy, name)(argument)
        try:
            return self._float(_CONSTANTS.get(name, getattr(math, name, None))(self._real(argument)))
        except (ValueError, OverflowError, ZeroDivisionError):
            raise FormulaTextError(f"it holds {name} of a constant, which is not a finite real number") from None

    def _of_several(self, name: str, node: ast.Call, depth: int) -> Any:
        """Functions of two arguments, Min and Max."""
        count = len(node.args)
        if node.keywords or (count != 2 if name in _TWO else not 1 <= count <= MAX_FACTORS):
            allowed = "two" if name in _TWO else f"1 to {MAX_FACTORS}"
            raise FormulaTextError(f"it gives {name} {count + len(node.keywords)} arguments: it takes {allowed}")
        given = [self.read(x, depth + 1) for x in node.args]
        if name in BESSEL and not (given[0].is_Integer and 0 <= given[0] <= MAX_ORDER - 3):
            raise FormulaTextError(
                f"it holds {name} of an order that is no whole number from 0 to {MAX_ORDER - 3}: write {name}(0, q)"
            )
        if name == "Mod" and given[1] == 0:
            raise FormulaTextError("it holds Mod(.., 0), which divides by zero")
        made = getattr(self.sympy, name)(*given)
        if made.has(self.sympy.nan, self.sympy.oo, self.sympy.zoo, self.sympy.I):
            raise FormulaTextError(f"it holds {name} of constants, which is not a finite real number")
        return made

    def _cases(self, node: ast.Call, depth: int) -> Any:
        """Piecewise((value, condition), .., (value, True))."""
        pairs = [x.elts for x in node.args if isinstance(x, ast.Tuple) and len(x.elts) == 2]
        if node.keywords or not pairs or len(pairs) < len(node.args):
            raise FormulaTextError("it gives Piecewise other than pairs: write Piecewise((q**2, q > 0), (0, True))")
        return self.sympy.Piecewise(
            *((self.read(value, depth + 1), self._condition(condition, depth + 1)) for value, condition in pairs)
        )

    def _condition(self, node: ast.AST, depth: int) -> Any:
        """A comparison, several joined by & and |, or True."""
        if depth > MAX_DEPTH:
            raise FormulaTextError(f"it is nested more than {MAX_DEPTH} deep")
        if isinstance(node, ast.Constant) and node.value is True:
            return self.sympy.true
        if isinstance(node, ast.BinOp) and type(node.op) in _JOINED:
            parts = [self._condition(x, depth + 1) for x in (node.left, node.right)]
            return getattr(self.sympy, _JOINED[type(node.op)])(*parts)
        if isinstance(node, ast.BoolOp):
            kind = "And" if isinstance(node.op, ast.And) else "Or"
            return getattr(self.sympy, kind)(*(self._condition(x, depth + 1) for x in node.values))
        if isinstance(node, ast.Compare) and len(node.ops) == 1 and type(node.ops[0]) in _COMPARED:
            sides = [self.read(x, depth + 1) for x in (node.left, node.comparators[0])]
            return getattr(self.sympy, _COMPARED[type(node.ops[0])])(*sides)
        raise FormulaTextError(
            "it chooses a case by something other than a comparison: write q > 0, or True at the end"
        )


def folded(name: Any) -> str:
    """A name as Python's parser normalises it: look-alike letters, such as both micro signs, become one."""
    return unicodedata.normalize("NFKC", str(name))


def is_name(name: str) -> bool:
    """Whether a name can occur in a text."""
    return name.isidentifier() and name not in _RESERVED


def check_name(name: str) -> None:
    """Refuse a name that cannot occur in a text."""
    if "[" in name:
        raise InvalidArgumentError(
            f"{checks.shown(name)} has an index, which names have not: call a few coordinates q1, q2, .. and momenta "
            "p1, p2, .. (those are found without being named), or write sums over sites, as Sum(q[i]**2, i), with n, "
            "the number of sites, and without q and p"
        )
    if not is_name(name):
        known = f"{', '.join(sorted(_RESERVED))} have a meaning"
        raise InvalidArgumentError(f"{checks.shown(name)} is no name for texts: letters, digits and _, and {known}")


def _what(node: ast.AST) -> str:
    """Describe a kind of node."""
    words = {
        ast.Attribute: "a dot between names",
        ast.Subscript: "an index in brackets, which sums over sites have, as Sum(q[i]**2, i) beside n, the number of "
        "sites (a single coordinate is q_1 in observables, and q1 where a few are given)",
        ast.Compare: "a comparison",
        ast.Lambda: "a lambda",
        ast.UnaryOp: "~ or not",
        ast.BoolOp: "and, or",
        ast.IfExp: "if and else",
        ast.JoinedStr: "a text",
    }
    return words.get(type(node), f"something else ({type(node).__name__})")
