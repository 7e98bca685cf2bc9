# SPDX-License-Identifier: BSD-3-Clause
"""The origin of a result as text for its files: time, command, version and scene."""

from __future__ import annotations

import datetime
import hashlib
import json
import os
import shlex
import sys
from collections.abc import Mapping

import numpy as np

from ..native.build import build_info
from .setup import Setup
from .states.law import States

_MOST = 64  # most numbers of an initial state that are written out


def made() -> dict[str, str]:
    """Time, command and versions; SOURCE_DATE_EPOCH replaces the time if it is set."""
    epoch = os.environ.get("SOURCE_DATE_EPOCH", "")
    now = datetime.datetime.now(datetime.UTC)
    if epoch.isdecimal() and len(epoch) < 12:
        now = datetime.datetime.fromtimestamp(int(epoch), datetime.UTC)
    folder, name = os.path.split(sys.argv[0]) if sys.argv else ("", "")
    begin = ["python", "-m", os.path.basename(folder)] if name == "__main__.py" else [name]
    command = shlex.join([*begin, *sys.argv[1:]])
    build = {f"symsde_{key.replace(' ', '_')}": value for key, value in build_info().items()}
    return {"date": now.isoformat(timespec="seconds"), "command": command, **build}


def seconds(timings: Mapping[str, float]) -> dict[str, float]:
    """Seconds that a run took; zeros if SOURCE_DATE_EPOCH requests reproducible files."""
    return {name: 0.0 if os.environ.get("SOURCE_DATE_EPOCH") else x for name, x in timings.items()}


def start_of(setup: Setup) -> dict[str, str]:
    """The initial states as text: numbers if they are few, else a hash of the array (dof, path) in float64."""
    return {name: told_state(x) for name, x in setup.start().items()}


def told_state(values: np.ndarray | States) -> str:
    """Initial states as text: numbers, or the table of a law."""
    return json.dumps(values.told()) if isinstance(values, States) else numbers_of(values)


def numbers_of(values: np.ndarray) -> str:
    """States (dof, path) as text; one state if all paths have the same."""
    if values.size <= _MOST:
        return json.dumps((values[:, 0] if values.shape[1] == 1 else values).tolist())
    digest = hashlib.sha256(np.ascontiguousarray(values, np.float64).tobytes()).hexdigest()
    return f"sha256 {digest} of {values.shape[0]} x {values.shape[1]} numbers"
