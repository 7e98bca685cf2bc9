# SPDX-License-Identifier: BSD-3-Clause
"""Exceptions of symsde. Those for bad input are ValueErrors too, so `except ValueError` catches them."""

from __future__ import annotations

import re

_LONGEST = 2000  #: most characters of a message that repeats an argument


def shortened(text: str) -> str:
    """Shorten a sentence: cut long words, and the middle of a long text."""
    if len(text) > _LONGEST:
        text = re.sub(r"\S{60,}", lambda word: word[0][:57] + "...", text)
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST // 2]} ... {text[-_LONGEST // 2 :]}"


class SymsdeError(Exception):
    """Base class of all exceptions of symsde. `code` is the status code of the C interface, or 0 if there is none."""

    code: int = 0

    def __str__(self) -> str:
        """The message, shortened if it repeats long arguments."""
        return shortened(super().__str__())


class LibraryNotFoundError(SymsdeError, ImportError):
    """The compiled library is missing, cannot be loaded, or is of another version."""


class InvalidArgumentError(SymsdeError, ValueError):
    """A value that is not allowed."""

    code = -1


class WrongTypeError(InvalidArgumentError, TypeError):
    """A value of a type that is not allowed."""


class IncompatibleError(SymsdeError, ValueError):
    """Scheme, model and options do not fit together."""

    code = -2


class UnknownNameError(SymsdeError, ValueError):
    """A model, scheme, parameter or key that does not exist."""

    code = -3


class WrongShapeError(SymsdeError, ValueError):
    """An array of the wrong shape."""

    code = -4


class TooLargeError(SymsdeError, ValueError):
    """Sizes beyond what the library can count or address, or more than the memory of the machine."""

    code = -5


class FalseTraitError(SymsdeError, ValueError):
    """A declared trait or Hessian that a probe refutes."""

    code = -6


class NullHandleError(SymsdeError, ValueError):
    """A handle of the library that was deleted."""

    code = -7


class OutOfMemoryError(SymsdeError, MemoryError):
    """No memory for a run of this size."""

    code = -8


class MissingOperationError(SymsdeError, ValueError):
    """The model lacks an operation that the call needs."""

    code = -9


class NumericalError(SymsdeError, ArithmeticError):
    """A computation failed as a whole. Failures of single paths are reported in their status instead."""


class CallbackError(SymsdeError, RuntimeError):
    """A compiled callback returned nonzero. Exceptions of Python callbacks are raised as they are."""

    code = 4


class SceneError(InvalidArgumentError):
    """A scene that cannot be run; the message names the file and the key."""


class NotWrittenError(SymsdeError, OSError):
    """A file or folder that cannot be written: no room, no permission."""


class MissingPackageError(SymsdeError, ImportError):
    """An optional package that is not installed."""


class PathsFailedWarning(RuntimeWarning):
    """Some paths of a run failed. Their later values are NaN, and moments leave them out."""


class NotANumberWarning(RuntimeWarning):
    """A value was not finite on a path that is ok, so its mean is not finite either."""


class DoubtfulRunWarning(RuntimeWarning):
    """A run is doubtful: for reasons known before it begins, as listed in `report.warnings`, or because paths grew
    1e6-fold."""


class UnsaidAbsorbWarning(FutureWarning):
    """A passage observer beside other results does not say whether it absorbs; from version 0.2 on that is an error."""


class RepeatedNoiseWarning(UserWarning):
    """A run begins where another run may have ended, but with the noise of the first steps of its seed."""


#: warnings about runs whose sentences are also in reports or moments; code that combines runs gives them once
OF_RUNS = (PathsFailedWarning, NotANumberWarning, RepeatedNoiseWarning, DoubtfulRunWarning, UnsaidAbsorbWarning)


class NotSavedWarning(UserWarning):
    """A file cannot hold all that was computed; the message names what is not in it."""


class SlowFormulaWarning(UserWarning):
    """Formulas are evaluated without a compiler; the message says how slow this is."""


class UnusedParameterWarning(UserWarning):
    """A parameter of formulas that no formula uses."""


class StandingSiteWarning(UserWarning):
    """The momentum of a site occurs in no term of H, since free ends leave out the summand that holds it."""


class KinkWarning(UserWarning):
    """A formula has a kink or a jump; the message says which orders hold."""


class OwnNoiseWarning(UserWarning):
    """A model in a heat bath has noises of its own, which heat it beside the bath."""


class BudgetWarning(UserWarning):
    """The time limit was too short for the requested interval."""


class ReferenceWarning(UserWarning):
    """An error is not larger than the error of the reference with which it was compared."""


_BY_CODE = {
    kind.code: kind
    for kind in (
        InvalidArgumentError,
        IncompatibleError,
        UnknownNameError,
        WrongShapeError,
        TooLargeError,
        FalseTraitError,
        NullHandleError,
        OutOfMemoryError,
        MissingOperationError,
        CallbackError,
    )
}


def from_code(code: int, message: str) -> SymsdeError:
    """Exception of a status code of the C interface."""
    error = _BY_CODE.get(code, NumericalError if code > 0 else SymsdeError)(message)
    error.code = code
    return error
