# SPDX-License-Identifier: BSD-3-Clause
"""Run one test file with pytest; exit 77 (skipped) where pytest is not installed."""

import importlib.util
import sys

if importlib.util.find_spec("pytest") is None:
    print("skipped: pytest is not installed; ./bootstrap test installs it in .venv")
    sys.exit(77)

import pytest

sys.exit(pytest.main(["-q", "-p", "no:cacheprovider", *sys.argv[1:]]))
