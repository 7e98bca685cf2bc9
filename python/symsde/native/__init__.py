# SPDX-License-Identifier: BSD-3-Clause
"""The library as ctypes sees it: loading, handles, callbacks, checks, files and progress."""
