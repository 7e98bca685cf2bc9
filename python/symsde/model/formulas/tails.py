# SPDX-License-Identifier: BSD-3-Clause
"""Derivatives that stay accurate where a function is close to its limit.

The usual derivative of tanh(u) is 1 - tanh(u)^2, and the second derivative of log(1 + exp(u)) is a difference of two
quotients: both are small differences of numbers near one, which rounding destroys. Here such functions are symbols
while formulas are differentiated, with rules that contain no such difference:

    tanh' = sech^2, sech' = -sech tanh, coth' = -csch^2, csch' = -csch coth, erf' and erfc' by gauss(u) = exp(-u^2)
    cosh^-n sinh^m          tanh^m sech^(n - m)
    D = sum_i c_i E_i       of exponentials and powers of cosh, E_i' = l_i E_i, with weights W_i = c_i E_i/D, whose sum
                            is one
    (log D)'                sum_i W_i l_i
    (E D^r)'                E D^r sum_i W_i (l + r l_i), with E' = l E; for W_i itself W_i sum_j W_j (l_i - l_j)

If the largest term of D has l + r l_i = 0, the other terms remain, without a difference. Expressions without such
functions are not changed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from .scaled import Scaled

MAX_TERMS = 6  #: most terms of a sum of exponentials: each derivative multiplies the number of terms by this number


@dataclass(frozen=True)
class StandIn:
    """The expression that a symbol replaces."""

    plain: Any  #: the expression, without stand-in symbols
    slope: Callable[[Any], Any]  #: variable -> derivative, in stand-in symbols
    gauss_of: Any = None  #: u, if the expression is exp(-u^2)
    is_weight: bool = False  #: whether the expression is E D^r, computed as a whole


class Tails:
    """The symbols of some formulas. `engine`: symengine or sympy; `moves`: whether an expression depends on the
    state.
    """

    def __init__(self, engine: Any, moves: Callable[[Any], bool]):
        """Start without symbols."""
        self.engine, self.moves = engine, moves
        self.known: dict[Any, StandIn] = {}
        self._symbols: dict[tuple, Any] = {}
        self._formed: dict[Any, Any] = {}

    # ---- there and back ----------------------------------------------------------------------------------

    def formed(self, e: Any) -> Any:
        """An expression with stand-in symbols; the same object if there are none."""
        if e not in self._formed:
            self._formed[e] = self._form(e) if e.args and self.moves(e) else e
        return self._formed[e]

    def diff(self, e: Any, x: Any) -> Any:
        """The derivative of a formed expression with respect to x."""
        result = e.diff(x)
        for symbol in sorted((s for s in e.free_symbols if s in self.known), key=str):
            if x in self.known[symbol].plain.free_symbols:
                result = result + e.diff(symbol) * self.known[symbol].slope(x)
        return result

    def plain(self, e: Any) -> Any:
        """The expression without stand-in symbols."""
        return e.subs({s: self.known[s].plain for s in e.free_symbols if s in self.known}) if self.known else e

    def written(self, e: Any, graph: Any, leaves: dict[str, bool]) -> Any:
        """The expression for evaluation: functions replace symbols, except for weights and gauss, which are nodes."""
        put = {}
        for symbol in (s for s in e.free_symbols if s in self.known):
            known = self.known[symbol]
            if known.gauss_of is not None:
                graph.stand_in(symbol, graph.node("gauss", graph.add(known.gauss_of, leaves)), known.plain)
            elif known.is_weight:
                graph.stand_in(symbol, Scaled(graph, leaves).whole(known.plain), known.plain)
            else:
                put[symbol] = known.plain
            leaves.setdefault(symbol.name, True)
        return e.subs(put) if put else e

    # ---- expressions -------------------------------------------------------------------------------------

    def _form(self, e: Any) -> Any:
        kind = type(e).__name__
        if kind in ("tanh", "coth", "sech", "csch", "erf", "erfc"):
            return self._function(kind, self.formed(e.args[0]))
        if kind == "log" and self._is_hyperbolic(e.args[0], "cosh"):
            u = self.formed(e.args[0].args[0])
            return self._symbol(("log", e), e, lambda x: self._function("tanh", u) * self.diff(u, x))
        if kind == "log" and (terms := self._terms(e.args[0])):
            return self._symbol(("log", e), e, lambda x: self._mean(e.args[0], terms, lambda i: terms[i][1](x)))
        if kind in ("Mul", "Pow"):
            return self._product(e)
        if kind == "Add" and (u := self._square_of_sech(e)) is not None:
            return self._function("sech", self.formed(u)) ** 2
        return e if kind == "Piecewise" else self._with(e, [self.formed(x) for x in e.args])

    @staticmethod
    def _with(e: Any, args: list[Any]) -> Any:
        return e if all(a is b or a == b for a, b in zip(args, e.args, strict=True)) else e.func(*args)

    def _function(self, kind: str, u: Any) -> Any:
        """Form tanh(u) and similar functions."""
        e = self.engine
        root = 2 / e.sqrt(e.pi)
        rules = {
            "tanh": lambda: self._function("sech", u) ** 2,
            "sech": lambda: -self._function("sech", u) * self._function("tanh", u),
            "coth": lambda: -(self._function("csch", u) ** 2),
            "csch": lambda: -self._function("csch", u) * self._function("coth", u),
            "erf": lambda: root * self._function("gauss", u),
            "erfc": lambda: -root * self._function("gauss", u),
            "gauss": lambda: -2 * u * self._function("gauss", u),
        }
        plain = self.plain(u)
        whole = e.exp(-(plain**2)) if kind == "gauss" else getattr(e, kind)(plain)
        return self._symbol((kind, u), whole, lambda x: rules[kind]() * self.diff(u, x), kind == "gauss" and plain)

    def _symbol(self, key: tuple, plain: Any, slope: Callable, gauss_of: Any = False, is_weight: bool = False) -> Any:
        if key not in self._symbols:
            symbol = self._symbols[key] = self.engine.Symbol(f"tail{len(self._symbols)}")
            self.known[symbol] = StandIn(plain, slope, None if gauss_of is False else gauss_of, is_weight)
        return self._symbols[key]

    def _product(self, e: Any) -> Any:
        """Form a product or a power."""
        factors = e.args if type(e).__name__ == "Mul" else (e,)
        exps, sums, rest = [], [], []
        hyperbolic: dict[tuple[str, Any], Any] = {}
        for x in factors:
            base, power = x.args if type(x).__name__ == "Pow" else (x, 1)
            if self._is_exponential(x):
                exps.append(x)
            elif any(self._is_hyperbolic(base, name) for name in ("cosh", "sinh")) and not self._moving(power):
                hyperbolic[type(base).__name__, base.args[0]] = power
            elif type(base).__name__ == "Add" and not self._moving(power) and not _is_positive_whole(power):
                (sums if self._terms(base) else rest).append(x)
            else:
                rest.append(x)
        for (name, u), n in list(hyperbolic.items()):
            if name == "cosh" and _is_negative(n) and any(self._ratio(x, u) is not None for x in exps):
                del hyperbolic[name, u]
                sums.append((self.engine.exp(u) / 2 + self.engine.exp(-u) / 2) ** n)
        if not sums and not any(_is_negative(n) for n in hyperbolic.values()):
            return self._with(e, [self._inside(x) for x in factors]) if len(factors) > 1 else self._inside(e)
        result = self._over_sums(exps, sums, hyperbolic, rest) if sums else self._inside_all(exps)
        for (name, u), n in hyperbolic.items():
            result = result * self._hyperbolic(name, u, n, hyperbolic)
        return result * self._inside_all(rest)

    def _inside_all(self, factors: Any) -> Any:
        return self._factors(self._inside(x) for x in factors)

    def _inside(self, x: Any) -> Any:
        """Form a factor, with symbols inside."""
        is_power = type(x).__name__ == "Pow"
        return self._with(x, [self.formed(a) for a in x.args]) if is_power else self.formed(x)

    def _hyperbolic(self, name: str, u: Any, n: Any, every: dict[tuple[str, Any], Any]) -> Any:
        """A power of cosh or sinh. sinh^m cosh^-n becomes tanh^k with k = min(m, n), times sech^(n - k) sinh^(m - k);
        likewise with coth and csch."""
        other = every.get(("sinh" if name == "cosh" else "cosh", u), 0)
        shared = 0
        for above, below in ((n, other), (other, n)):
            if _is_positive_whole(above) and _is_negative(below):
                shared = min(int(above), int(-float(below)))
        formed, inverse = self.formed(u), {"cosh": "sech", "sinh": "csch"}[name]
        if _is_negative(n):
            return self._function(inverse, formed) ** (-n - shared)
        quotient = {"cosh": "coth", "sinh": "tanh"}[name]
        return self._function(quotient, formed) ** shared * getattr(self.engine, name)(formed) ** (n - shared)

    def _over_sums(self, exps: list, sums: list, hyperbolic: dict, rest: list) -> Any:
        """Exponentials over powers of sums of exponentials; growing sums in the numerator are multiplied out."""
        engine = self.engine
        below, *others = [x.args for x in sums]
        mine = below[0].free_symbols
        above = self._factors(x for x in exps if x.free_symbols & mine)
        apart = self._inside_all(x for x in exps if not x.free_symbols & mine)
        own = [x for x in _atoms(below[0]) if self._is_hyperbolic(x, "cosh")]
        for (name, u), n in list(hyperbolic.items()):
            if _is_positive_whole(n) and name == "cosh" and engine.cosh(u) in own:
                above = above * engine.cosh(u) ** hyperbolic.pop((name, u))
        if not own:
            for (name, u), n in list(hyperbolic.items()):
                if _is_positive_whole(n) and u.free_symbols & mine:
                    sign = 1 if name == "cosh" else -1
                    above = above * (engine.exp(u) / 2 + sign * engine.exp(-u) / 2) ** n
                    del hyperbolic[name, u]
        for x in list(rest):
            base, power = x.args if type(x).__name__ == "Pow" else (x, 1)
            if type(base).__name__ == "Add" and _is_positive_whole(power) and self._terms(base):
                above = above * x
                rest.remove(x)
        above = engine.expand(above)
        result = 0
        for term in above.args if type(above).__name__ == "Add" else (above,):
            still, growing = self._split(term)
            result = result + still * self._weight(growing, *below)
        for base, power in others:
            result = result * self._weight(engine.Integer(1), base, power)
        return apart * result

    # ---- sums of exponentials ----------------------------------------------------------------------------

    def _weight(self, growing: Any, base: Any, power: Any) -> Any:
        """The weight E D^r."""
        terms = self._terms(base)

        def slope(x: Any) -> Any:
            own = self._rate(growing)(x)
            return symbol * self._mean(base, terms, lambda i: own + power * terms[i][1](x))

        symbol = self._symbol(("weight", growing, base, power), growing * base**power, slope, is_weight=True)
        return symbol

    def _mean(self, base: Any, terms: list, of: Callable[[int], Any]) -> Any:
        """The mean sum_i W_i of(i), where of(i) is a function of the term i."""
        result = 0
        for i, ((still, growing), _) in enumerate(terms):
            value = self.engine.expand(of(i))
            if value != 0:
                result = result + still * self._weight(growing, base, self.engine.Integer(-1)) * value
        return result

    def _terms(self, e: Any) -> list:
        """The terms of a sum of exponentials, each as ((c, E), rate of E); empty for other expressions."""
        if type(e).__name__ != "Add" or len(e.args) > MAX_TERMS:
            return []
        parts = [self._split(x) for x in e.args]
        rates = [self._rate(growing) for _, growing in parts]
        constants = sum(growing == 1 for _, growing in parts)
        if any(rate is None for rate in rates) or constants > 1 or constants == len(parts):
            return []
        return list(zip(parts, rates, strict=True))

    def _split(self, term: Any) -> tuple[Any, Any]:
        """Split a term into (constant factor) x (factor that depends on the state)."""
        still, growing = self.engine.Integer(1), self.engine.Integer(1)
        for x in term.args if type(term).__name__ == "Mul" else (term,):
            if self._moving(x):
                growing = growing * x
            else:
                still = still * x
        return still, growing

    def _rate(self, growing: Any) -> Callable[[Any], Any] | None:
        """x -> E_x/E for a product of exponentials and powers of cosh; None for other expressions."""
        found = []
        for x in _factors(growing):
            base, power = x.args if type(x).__name__ == "Pow" else (x, 1)
            if self._is_exponential(x):
                u = self.formed(x.args[-1])
                rate = self.engine.Integer(1) if type(x).__name__ == "exp" or _is_e(base) else self.engine.log(base)
                found.append((rate, u))
            elif self._is_hyperbolic(base, "cosh") and _is_positive_whole(power):
                u = self.formed(base.args[0])
                found.append((power * self._function("tanh", u), u))
            elif x != 1:
                return None
        return lambda x: sum((rate * self.diff(u, x) for rate, u in found), self.engine.Integer(0))

    def _is_exponential(self, e: Any) -> bool:
        kind = type(e).__name__
        return (kind == "exp") or (kind == "Pow" and self._moving(e.args[1]) and not self._moving(e.args[0]))

    def _is_hyperbolic(self, e: Any, name: str) -> bool:
        return type(e).__name__ == name and self._moving(e)

    def _moving(self, e: Any) -> bool:
        return (bool(getattr(e, "args", ())) and self.moves(e)) or (hasattr(e, "free_symbols") and self.moves(e))

    def _ratio(self, exponential: Any, u: Any) -> Any:
        """The ratio of an exponential's exponent and u, if it is a number."""
        ratio = self.engine.expand(exponential.args[-1] / u)
        return None if ratio.free_symbols else ratio

    def _square_of_sech(self, e: Any) -> Any:
        """The u of 1 - tanh(u)**2."""
        for one, other in (e.args, e.args[::-1]) if len(e.args) == 2 else ():
            base, power = (-other).args if type(-other).__name__ == "Pow" else (other, 1)
            if one == 1 and power == 2 and type(base).__name__ == "tanh" and self._moving(base):
                return base.args[0]
        return None

    def _factors(self, factors: Any) -> Any:
        result = self.engine.Integer(1)
        for x in factors:
            result = result * x
        return result


def _factors(e: Any) -> tuple:
    return e.args if type(e).__name__ == "Mul" else (e,)


def _atoms(e: Any) -> list:
    """The factors of all terms of a sum, without their powers."""
    return [x.args[0] if type(x).__name__ == "Pow" else x for term in e.args for x in _factors(term)]


def _is_e(base: Any) -> bool:
    return type(base).__name__ == "Exp1"


def _is_positive_whole(power: Any) -> bool:
    number = _number(power)
    return number is not None and number > 0 and number == int(number)


def _is_negative(power: Any) -> bool:
    number = _number(power)
    return number is not None and number < 0


def _number(power: Any) -> float | None:
    return float(power) if isinstance(power, int) or getattr(power, "is_Number", False) else None
