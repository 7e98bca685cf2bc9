# SPDX-License-Identifier: BSD-3-Clause
"""python -m symsde."""

import sys

from .cli.command_line import main

if __name__ == "__main__":
    sys.exit(main())
