# SPDX-License-Identifier: BSD-3-Clause
"""The old name of `symsde.studies`, until version 0.2."""

import sys

from . import studies
from .native import checks

checks.warn("symsde.reports is now symsde.studies: import that", DeprecationWarning)
sys.modules[__name__] = studies
