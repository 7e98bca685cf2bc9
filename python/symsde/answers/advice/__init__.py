# SPDX-License-Identifier: BSD-3-Clause
"""Which scheme, and which step: advice from short runs."""
