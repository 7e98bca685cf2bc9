# SPDX-License-Identifier: BSD-3-Clause
"""The library seen from ctypes: loading, handles, callbacks, checks, files and progress."""
