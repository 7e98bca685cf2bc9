# SPDX-License-Identifier: BSD-3-Clause
"""A shard as a file: an .npz that NumPy opens, whose comment at the end is the SHA-256 of all bytes before the
comment."""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import NotWrittenError, SymsdeError
from ..native import files

_DIGITS = 64  # digits of a SHA-256


class DamagedShardError(SymsdeError, ValueError):
    """A shard whose bytes have changed since it was written."""


@dataclass(frozen=True)
class Shard:
    """The results of a piece: arrays, and facts in types of JSON."""

    arrays: Mapping[str, np.ndarray]
    facts: Mapping[str, Any]


def to_bytes(shard: Shard) -> bytes:
    """Encode a shard; the same shard always gives the same bytes."""
    buffer = io.BytesIO()
    facts = np.array(json.dumps(dict(shard.facts), sort_keys=True))
    np.savez(buffer, **{name: shard.arrays[name] for name in sorted(shard.arrays)}, facts=facts)
    with zipfile.ZipFile(buffer, "a") as archive:
        archive.comment = b"0" * _DIGITS
    content = buffer.getvalue()[:-_DIGITS]
    return content + hashlib.sha256(content).hexdigest().encode()


def from_bytes(content: bytes, name: str) -> Shard:
    """Decode a shard; DamagedShardError if a byte has changed."""
    if hashlib.sha256(content[:-_DIGITS]).hexdigest().encode() != content[-_DIGITS:]:
        raise DamagedShardError(f"{name} is damaged: its checksum is not that of its {len(content)} bytes")
    with np.load(io.BytesIO(content)) as data:
        arrays = {key: data[key] for key in data.files}
    return Shard(facts=json.loads(str(arrays.pop("facts"))), arrays=arrays)


def write(target: Path, shard: Shard) -> bool:
    """Write a shard; false if another process has written it first, whose shard remains."""
    return files.write_durably(target, to_bytes(shard))


def read(path: Path) -> Shard:
    """Read and verify a shard."""
    try:
        content = files.content(path)
    except FileNotFoundError:
        raise
    except OSError as error:
        raise NotWrittenError(f"{path} cannot be read: {error.strerror}: remove it, or make it readable") from None
    return from_bytes(content, str(path))
