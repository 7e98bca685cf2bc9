# SPDX-License-Identifier: BSD-3-Clause
"""Calls into the library: a new error for every call, handles that delete themselves, and a handle for each active
call.
"""

from __future__ import annotations

import ctypes
import functools
import weakref
from collections.abc import Callable

from ..errors import from_code
from . import abi, checks
from .library import library


def call(name: str, *arguments, allow: tuple[int, ...] = ()) -> int:
    """Call symsde_<name>, whose last argument is the error; raise unless ok or an allowed status."""
    error = abi.Error()
    status = getattr(library, f"symsde_{name}")(*arguments, ctypes.byref(error))
    if status != abi.OK and status not in allow:
        message = error.message.decode("utf-8", "replace") or status_text(status)
        raise from_code(status, message)
    return status


def new(struct: type[ctypes.Structure], name: str) -> ctypes.Structure:
    """A struct of the C interface with its defaults, by symsde_<name>_init."""
    return struct.from_buffer_copy(_defaults(struct, name))


@functools.cache
def _defaults(struct: type[ctypes.Structure], name: str) -> bytes:
    value = struct()
    getattr(library, f"symsde_{name}_init")(ctypes.byref(value))
    return bytes(value)


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
    """Text of a status code of a call or of a path."""
    return _text_of(checks.integer("code", code, checks.INT32))


@functools.lru_cache(maxsize=64)
def _text_of(code: int) -> str:
    return text("status_text", code)


def encode(value: str) -> bytes:
    """A name as C text; a name that C cannot represent becomes one that is refused as unknown."""
    return value.encode("utf-8", "replace").replace(b"\0", b"?")


def _delete(noun: str, address: int, _keep_alive) -> None:
    getattr(library, f"symsde_{noun}_delete")(ctypes.byref(ctypes.c_void_p(address)))


class Handle:
    """An opaque handle of the library, deleted when nothing refers to it; `keep_alive` lives longer than the
    handle."""

    def __init__(self, noun: str, pointer: ctypes.c_void_p, keep_alive: object = None):
        """Own the handle."""
        self.pointer = pointer
        finalizer = weakref.finalize(self, _delete, noun, pointer.value, keep_alive)
        finalizer.atexit = False


class Pool:
    """Handles of one model, one for each active call: a handle keeps the exceptions of its call's callbacks.

    A single handle with a lock could deadlock: a callback may call its own model from another thread of the run, and
    would wait for the call that waits for the callback.
    """

    def __init__(self, make: Callable[[], Handle]):
        """Make one handle immediately."""
        self._make = make
        self._idle = [make()]

    @property
    def made(self) -> Callable[[], Handle]:
        """The function that makes another handle of the model, for a pool of another kind."""
        return self._make

    def take(self) -> Handle:
        """Take a handle, to be returned after use."""
        try:
            return self._idle.pop()
        except IndexError:
            return self._make()

    def give(self, handle: Handle) -> None:
        """Return a handle."""
        self._idle.append(handle)
