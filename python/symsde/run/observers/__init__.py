# SPDX-License-Identifier: BSD-3-Clause
"""What a run keeps as it goes: requests, the arrays that the library fills, and results."""
