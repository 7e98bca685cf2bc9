# SPDX-License-Identifier: BSD-3-Clause
"""Exponentially growing expressions, written as exp(exponent) x mantissa, so that their quotients do not overflow.

exp(u)/(1 + exp(u))^2 is at most of order one for every u, but computed directly it is infinity over infinity from
u = 710 on. Here the exponents of factors are added before exp is applied: with M = max(0, u) the quotient is
exp(u - 2 M)/(exp(-M) + exp(u - M))^2. The same holds for cosh, sinh (tanh x cosh) and c**u, their sums, products and
powers; the logarithm is the exponent plus the logarithm of the mantissa. Expressions that cannot overflow internally
stay unchanged.
"""

from __future__ import annotations

from typing import Any

Powers = dict[int, float]  #: node of a graph -> its coefficient in a sum, or its exponent in a product


class Scaled:
    """Converts expressions to exponents and mantissas, in nodes of a graph."""

    def __init__(self, graph: Any, leaves: dict[str, bool]):
        """`leaves`: name -> whether it differs from lane to lane."""
        self.graph, self.leaves = graph, leaves

    def node(self, e: Any) -> int | None:
        """The node of an expression; None if the expression is computed without scaling."""
        kind = type(e).__name__
        if kind == "Add" and (u := self._falls(e)) is not None:
            return self.graph.power(self.graph.node("sech", self.graph.add(u, self.leaves)), 2)
        if kind == "log" and self.grows(e.args[0]):
            return self._log(e.args[0])
        if kind == "asinh" and self.grows(e.args[0]):
            return self._asinh(*self._parts(e.args[0]))
        if (kind == "Pow" and not _whole(e.args[1]) and not self._is_exponential(e) and self.grows(e.args[0])) or (
            kind == "Mul" and self._may_overflow(e.args)
        ):
            return self.whole(e)
        return None

    def whole(self, e: Any) -> int:
        """The node of a growing expression: no part overflows, and no part underflows unless the whole expression
        does."""
        exponent, mantissa = self._parts(e)
        return self.graph.multiply(self._exp(exponent), self._product(mantissa))

    def grows(self, e: Any, weights: bool = True) -> bool:
        """Whether an expression contains an exponential of the state as a term, factor or power, or a weight
        (tails.py), which is usually bounded."""
        kind = type(e).__name__
        if e in self.graph.stand_ins:
            return weights and self.grows(self.graph.stand_ins[e])
        if kind in ("Add", "Mul"):
            return any(self.grows(x, weights) for x in e.args) or self._falls(e) is not None
        return self._is_exponential(e) or (kind == "Pow" and self.grows(e.args[0], weights))

    def _is_exponential(self, e: Any) -> bool:
        kind = type(e).__name__
        if kind == "Pow":
            return self._moves(e.args[1]) and not self._moves(e.args[0])
        return kind in ("exp", "cosh", "sinh", "sech", "csch") and self._moves(e.args[0])

    def _falls(self, e: Any) -> Any:
        """The u of 1 - tanh(u)**2 = cosh(u)**(-2), the form of derivatives of tanh; else None."""
        if type(e).__name__ == "Add" and len(e.args) == 2:
            for one, other in (e.args, e.args[::-1]):
                square = -other
                if one == 1 and type(square).__name__ == "Pow" and square.args[1] == 2 and self._moves(square):
                    return square.args[0].args[0] if type(square.args[0]).__name__ == "tanh" else None
        return None

    def _moves(self, e: Any) -> bool:
        return any(self.leaves[x.name] for x in e.free_symbols)

    def _may_overflow(self, factors: Any) -> bool:
        """Whether a growing or decaying factor is in the numerator; weights alone do not count."""
        grown = [x for x in factors if self.grows(x)]
        alone = [x for x in grown if self.grows(x, weights=False)]
        return bool(alone) and len(grown) > 1 and any(self._rises(x) for x in alone)

    def _rises(self, e: Any, sign: int = 1) -> bool:
        """Whether a factor has a growing part in the numerator; sech and csch count as denominators."""
        kind = type(e).__name__
        if not self.grows(e, weights=False) or self._falls(e) is not None:
            return False
        if kind in ("Add", "Mul"):
            return any(self._rises(x, sign) for x in e.args)
        if kind == "Pow" and not self._is_exponential(e):
            return self._rises(e.args[0], sign * _sign(e.args[1])) or _sign(e.args[1]) == 0
        return sign < 0 if kind in ("sech", "csch") else sign > 0

    def _parts(self, e: Any) -> tuple[Powers, Powers]:
        """The exponent, and the factors of the mantissa."""
        graph, kind = self.graph, type(e).__name__
        if not self.grows(e):
            return {}, {graph.add(e, self.leaves): 1.0}
        if e in graph.stand_ins:
            return self._parts(graph.stand_ins[e])
        if kind == "Mul":
            exponent: Powers = {}
            mantissa: Powers = {}
            for x in e.args:
                _join(self._parts(x), (exponent, mantissa))
            return exponent, mantissa
        if (u := self._falls(e)) is not None:
            return tuple({x: -2 * n for x, n in part.items()} for part in self._hyperbolic(e, u))
        if kind == "Add":
            return self._sum(e.args)
        is_hyperbolic = kind in ("cosh", "sinh", "sech", "csch")
        return self._hyperbolic(e, e.args[0]) if is_hyperbolic else self._power(e)

    def _log(self, e: Any) -> int:
        """The logarithm of a growing expression."""
        if type(e).__name__ == "cosh":
            return self.graph.node("logcosh", self.graph.add(e.args[0], self.leaves))
        rest = e - 1
        if type(e).__name__ == "Add" and self.grows(rest) and not _has_number(rest):
            return self._log1p(*self._parts(rest))
        exponent, mantissa = self._parts(e)
        return self.graph.sum((self._total(exponent), self.graph.node("log", self._product(mantissa))))

    def _log1p(self, exponent: Powers, mantissa: Powers) -> int:
        """log(1 + m exp(E)), with F = max(0, E - 300), so that no digits are lost before exp(E) overflows:
        F + log1p(m exp(E - F) + (exp(-F) - 1))."""
        graph = self.graph
        beyond = graph.sum((self._total(exponent), graph.number(-300.0)))
        twice = graph.sum((beyond, graph.node("fabs", beyond)))
        grown = graph.multiply(self._exp(_joined(exponent, {twice: -0.5})), self._product(mantissa))
        less = graph.sum((self._exp({twice: -0.5}), graph.number(-1.0)))
        return graph.sum((graph.multiply(graph.number(0.5), twice), graph.node("log1p", graph.sum((grown, less)))))

    def _asinh(self, exponent: Powers, mantissa: Powers) -> int:
        """asinh(m exp(E)), with F = max(0, E) and y = m exp(E - F), which is moderate: asinh y plus, with the sign of
        y, F + log((|y| + sqrt(y^2 + exp(-2 F)))/(|y| + sqrt(y^2 + 1)))."""
        graph, number, sqrt = self.graph, self.graph.number, lambda x: self.graph.node("sqrt", x)
        total = self._total(exponent)
        size, half = graph.node("fabs", total), number(0.5)
        more = graph.multiply(half, graph.sum((total, size)))
        rest = graph.node("exp", graph.multiply(half, graph.sum((total, graph.negative(size)))))
        y = graph.multiply(rest, self._product(mantissa))
        away, square = graph.node("fabs", y), graph.multiply(y, y)
        above = graph.sum((away, sqrt(graph.sum((square, self._exp({more: -2.0}))))))
        below = graph.sum((away, sqrt(graph.sum((square, number(1.0))))))
        sign = graph.quotient(y, graph.sum((away, number(1e-300))))
        far = graph.sum((more, graph.node("log", graph.quotient(above, below))))
        return graph.sum((graph.node("asinh", y), graph.multiply(sign, far)))

    def _hyperbolic(self, e: Any, u: Any) -> tuple[Powers, Powers]:
        """cosh u = exp |u| (1 + exp(-2 |u|))/2, sinh = tanh cosh."""
        graph = self.graph
        odd = {graph.node("tanh", graph.add(u, self.leaves)): 1.0} if type(e).__name__ in ("sinh", "csch") else {}
        [(u, n)] = self._exponent(u).items()
        size = graph.node("fabs", u)
        other = self._exp({size: -2 * abs(n)})
        half = graph.multiply(graph.number(0.5), graph.sum((graph.number(1.0), other)))
        times = -1.0 if type(e).__name__ in ("sech", "csch") else 1.0
        return {size: times * abs(n)}, {x: times * k for x, k in ({half: 1.0} | odd).items()}

    def _power(self, e: Any) -> tuple[Powers, Powers]:
        """Split exp u, c**u, and powers of growing expressions."""
        graph = self.graph
        if type(e).__name__ == "exp" or type(e.args[0]).__name__ == "Exp1":
            return self._exponent(e.args[-1]), {}
        base, power = e.args
        if self._is_exponential(e):
            rate = graph.node("log", graph.add(base, self.leaves))
            return {graph.multiply(rate, u): n for u, n in self._exponent(power).items()}, {}
        exponent, mantissa = self._parts(base)
        if getattr(power, "is_Number", False):
            return tuple({x: n * float(power) for x, n in part.items()} for part in (exponent, mantissa))
        n = graph.add(power, self.leaves)
        return {graph.multiply(self._total(exponent), n): 1.0}, {graph.node("pow", self._product(mantissa), n): 1.0}

    def _exponent(self, u: Any) -> Powers:
        """Write u as a multiple of a node that all multiples of u share, so that they cancel exactly."""
        n = _multiple(u)
        terms = u.args if type(u).__name__ == "Add" else (u,)
        return {self.graph.sum(self.graph.add(x / n, self.leaves) for x in terms): float(n)}

    def _sum(self, terms: Any) -> tuple[Powers, Powers]:
        """A sum: the largest exponent is factored out; it need not be exactly the largest."""
        graph, still = self.graph, [x for x in terms if not self.grows(x)]
        found = [self._parts(x) for x in terms if self.grows(x)]
        if still:
            found.append(({}, {graph.sum(graph.add(x, self.leaves) for x in still): 1.0}))
        largest = found[0][0]
        for exponent, _ in found[1:]:  # max(a, b) = (a + b)/2 + |a - b|/2
            apart = {x: n for x, n in _joined(largest, exponent, -1.0).items() if n}
            first = next(iter(apart.values()), 1.0)
            size = graph.node("fabs", self._total({x: n / first for x, n in apart.items()}))
            middle = {x: n / 2 for x, n in _joined(largest, exponent).items()}
            largest = _joined(middle, {size: abs(first) / 2})
        scaled = (
            graph.multiply(self._exp(_joined(exponent, largest, -1.0)), self._product(mantissa))
            for exponent, mantissa in found
        )
        return largest, {graph.sum(scaled): 1.0}

    def _total(self, exponent: Powers) -> int:
        """Add multiples of exponents, and combine multiples of the same node, since then d - |d| is exact."""
        graph, groups = self.graph, {}
        for x, n in exponent.items():
            groups.setdefault(abs(n), []).append(x if n > 0 else graph.negative(x))
        return graph.sum(graph.multiply(graph.number(n), graph.sum(group)) for n, group in groups.items() if n)

    def _exp(self, exponent: Powers) -> int:
        total = self._total(exponent)
        return self.graph.number(1.0) if self.graph.is_number(total, 0.0) else self.graph.node("exp", total)

    def _product(self, mantissa: Powers) -> int:
        """A product of powers, with one division."""
        graph = self.graph
        above = graph.product(graph.raised(x, n) for x, n in mantissa.items() if n > 0)
        below = graph.product(graph.raised(x, -n) for x, n in mantissa.items() if n < 0)
        return graph.quotient(above, below)


def _joined(a: Powers, b: Powers, times: float = 1.0) -> Powers:
    return {x: a.get(x, 0.0) + times * b.get(x, 0.0) for x in (*a, *(x for x in b if x not in a))}


def _join(found: tuple[Powers, Powers], into: tuple[Powers, Powers]) -> None:
    for part, whole in zip(found, into, strict=True):
        whole.update(_joined(whole, part))


def _multiple(u: Any) -> Any:
    """The numerical factor of an expression; of a sum, the factor of its first term."""
    terms = [x for x in u.args if x.free_symbols] if type(u).__name__ == "Add" else [u]
    first = min(terms, key=lambda x: sorted(s.name for s in x.free_symbols))
    result = first / first
    for x in first.args if type(first).__name__ == "Mul" else ():
        if not x.free_symbols:
            result = result * x
    return result


def _has_number(e: Any) -> bool:
    """Whether a sum has a number among its terms."""
    return any(getattr(x, "is_Number", False) for x in (e.args if type(e).__name__ == "Add" else (e,)))


def _sign(power: Any) -> int:
    """The sign of an exponent; 0 if it depends on parameters."""
    return (-1 if float(power) < 0 else 1) if getattr(power, "is_Number", False) else 0


def _whole(power: Any) -> bool:
    return bool(getattr(power, "is_Number", False)) and float(power) == int(float(power))
