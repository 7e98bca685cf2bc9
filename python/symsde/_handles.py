# SPDX-License-Identifier: BSD-3-Clause
"""Calls into the library: a fresh error for every call, handles that delete themselves."""

from __future__ import annotations

import contextlib
import ctypes
import threading
import weakref
from collections.abc import Iterator

from . import _abi
from ._library import library
from .errors import from_code


def call(name: str, *arguments, allow: tuple[int, ...] = ()) -> int:
    """Call symsde_<name>, whose last argument is the error; raise unless ok or an allowed status."""
    error = _abi.Error()
    status = getattr(library, f"symsde_{name}")(*arguments, ctypes.byref(error))
    if status != _abi.OK and status not in allow:
        message = error.message.decode("utf-8", "replace") or status_text(status)
        raise from_code(status, message)
    return status


def new(struct: type[ctypes.Structure], name: str) -> ctypes.Structure:
    """A struct of the C interface with its defaults, by symsde_<name>_init."""
    value = struct()
    getattr(library, f"symsde_{name}_init")(ctypes.byref(value))
    return value


def text(name: str, *before, has_error: bool = False) -> str:
    """Text that symsde_<name> copies into a buffer, which grows as needed."""
    size, needed = 1024, ctypes.c_size_t(0)
    while True:
        buffer = ctypes.create_string_buffer(size)
        arguments = (*before, buffer, size, ctypes.byref(needed))
        if has_error:
            call(name, *arguments)
        else:
            getattr(library, f"symsde_{name}")(*arguments)
        if needed.value <= size:
            return buffer.value.decode("utf-8", "replace")
        size = needed.value


def status_text(code: int) -> str:
    """Text of a status code, of a call or of a path."""
    return text("status_text", int(code))


def encode(value: str) -> bytes:
    """A name as C text; what cannot be one becomes a name that is refused as unknown."""
    return value.encode("utf-8", "replace").replace(b"\0", b"?")


def _delete(noun: str, address: int, _keep_alive) -> None:
    getattr(library, f"symsde_{noun}_delete")(ctypes.byref(ctypes.c_void_p(address)))


class Handle:
    """An opaque handle of the library, deleted when nothing refers to it any more.

    `keep_alive` (callbacks) outlives it. `lock` serves one thread at a time, as the library asks.
    """

    def __init__(self, noun: str, pointer: ctypes.c_void_p, keep_alive: object = None):
        self.pointer = pointer
        self.lock = threading.RLock()
        finalizer = weakref.finalize(self, _delete, noun, pointer.value, keep_alive)
        finalizer.atexit = False


@contextlib.contextmanager
def held(*owners) -> Iterator[None]:
    """Hold the locks of models and schemes, in this order, during a call."""
    with contextlib.ExitStack() as stack:
        for owner in owners:
            stack.enter_context(owner._handle.lock)
        yield
