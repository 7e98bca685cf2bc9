# SPDX-License-Identifier: BSD-3-Clause
"""Names of the values of a run: coordinates and momenta as named by the model, the energy, observables."""

from __future__ import annotations

import functools
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from ..errors import UnknownNameError, WrongTypeError
from ..native import checks

_NUMBERED = re.compile(r"([qp])_?(\d*)")


@functools.cache
def numbered(ndof: int) -> tuple[str, ...]:
    """Names of coordinates and momenta of a model that has none of its own: q_1 .., p_1 .."""
    return tuple(f"{x}_{i + 1}" for x in "qp" for i in range(ndof))


@dataclass(frozen=True)
class Values:
    """Values in the order of columns: coordinates, momenta, the energy if it is known, observables."""

    names: tuple[str, ...]
    ndof: int  #: number of degrees of freedom; the first 2*ndof names are coordinates and momenta

    @classmethod
    @functools.lru_cache(maxsize=256)
    def of(cls, coordinates: tuple[str, ...], has_energy: bool, observables: tuple[str, ...] = ()) -> Values:
        """Make the names from coordinates and momenta, 2*ndof names, and the further values of a run."""
        return cls((*coordinates, *(["energy"] if has_energy else []), *observables), len(coordinates) // 2)

    @property
    def q(self) -> tuple[str, ...]:
        """Names of the coordinates."""
        return self.names[: self.ndof]

    @property
    def p(self) -> tuple[str, ...]:
        """Names of the momenta."""
        return self.names[self.ndof : 2 * self.ndof]

    @property
    def has_energy(self) -> bool:
        """Whether the energy is one of the values."""
        return self.names[2 * self.ndof : 2 * self.ndof + 1] == ("energy",)

    @property
    def observables(self) -> tuple[str, ...]:
        """Names of the observables."""
        return self.names[2 * self.ndof + self.has_energy :]

    def called(self, name: str) -> str:
        """The name of a value in results: q_1 and q1 mean the first coordinate, and so does q if there is only one."""
        if name in self.names or not (found := _NUMBERED.fullmatch(name)):
            return name
        letter, number = found.groups()
        if not number and self.ndof > 1:
            return name
        place = int(number[:9] or 1)
        return (self.q if letter == "q" else self.p)[place - 1] if 1 <= place <= self.ndof else f"{letter}_{number}"

    def chosen(self, what: str, given: object) -> list[str] | None:
        """Some of the values, given by one name or by a list of names; None if no name is given."""
        return chosen(what, given, self.names, self.called)


def chosen(what: str, given: object, known: Sequence[str], called: Callable[[str], str] = str) -> list[str] | None:
    """Some of the known names, given as one name or as a list of names; None if no name is given."""
    if given is None:
        return None
    several = [given] if isinstance(given, str) else checks.items(given)
    if not several or not all(isinstance(name, str) for name in several):
        raise WrongTypeError(
            f"{what} = {checks.shown(given)} holds no names: give one name, or a list of one or more, as ['{known[0]}']"
        )
    names = [called(name) for name in several]
    for name in names:
        if name not in known:
            raise UnknownNameError(f"there is no value {name!r}: there are {checks.nearest(name, known)}")
    return names
