# SPDX-License-Identifier: BSD-3-Clause
"""Run one test file with pytest; exit 77 (skipped) where pytest is not installed."""

import importlib.util
import sys


def main() -> int:
    """Run pytest; the result is its exit code."""
    if importlib.util.find_spec("pytest") is None:
        print("skipped: pytest is not installed; ./bootstrap test installs it in .venv")
        return 77
    import pytest

    return pytest.main(["-q", "-p", "no:cacheprovider", *sys.argv[1:]])


if __name__ == "__main__":  # processes spawned by tests import this file, too
    sys.exit(main())
