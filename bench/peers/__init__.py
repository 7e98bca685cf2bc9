# SPDX-License-Identifier: BSD-3-Clause
"""Other packages on the same problems: error against run time."""
