# SPDX-License-Identifier: BSD-3-Clause
"""Information on the library's build."""

from __future__ import annotations

import functools

from . import handles


def build_info() -> dict[str, str]:
    """Version, compiler and options of the library, and the version of the counter map of its noise."""
    return dict(_build_info())


@functools.cache
def _build_info() -> dict[str, str]:
    lines = (line.partition(":") for line in handles.text("build_info").splitlines() if ":" in line)
    return {key.strip(): value.strip() for key, _, value in lines}
