# SPDX-License-Identifier: BSD-3-Clause
"""check_static.py LIST: exit 1 where an object named in LIST holds variables that threads share, or calls with
machine-dependent bits.

Handles are independent only if all data that outlive a call belong to a handle: no saved variable, no module variable,
no COMMON. gfortran 12 adds such storage itself: for the length of a function result of deferred length (slen.N), and
for large local arrays, if -frecursive is missing.

Loops over sin, cos, exp and log become calls of the C library's vector functions (_ZGV..), whose last bits depend on
the width of the registers and on the processor: src/base/sincos.f90 has sincos_lanes and sine_of for these.
"""

import re
import struct
import sys
from pathlib import Path

OBJECT, COMMON = 1, 0xFFF2
# Variables never written after the program is loaded: tables of types, their initial values, the names of locks.
CONSTANT = re.compile(r"___vtab_|___def_init_|^\.gomp_critical_user_|^loading_process$|^strict_overcommit$")
# Data of the process, changed under a lock alone: the users of a single-threaded BLAS, and the functions found in it.
GUARDED = re.compile(r"^blas_(users|choice|lock|sought|serves|reader|setter)$")


def sections(data):
    """(name, type, offset, size, link) of every section of a 64-bit little-endian ELF file."""
    if data[:6] != b"\x7fELF\x02\x01":
        raise SystemExit("not a 64-bit little-endian ELF file")
    (offset,) = struct.unpack_from("<Q", data, 40)
    size, count, names = struct.unpack_from("<HHH", data, 58)
    headers = [struct.unpack_from("<IIQQQQI", data, offset + index * size) for index in range(count)]
    start = headers[names][4]
    return [(text(data, start + h[0]), h[1], h[4], h[5], h[6]) for h in headers]


def text(data, start):
    """The null-terminated string at this offset."""
    return data[start : data.index(b"\0", start)].decode()


def symbols(data):
    """(name, type, section's index and name) of every symbol of an object."""
    parts = sections(data)
    for _, kind, offset, size, link in parts:
        if kind != 2:  # only the symbol table has symbols
            continue
        for entry in range(offset, offset + size, 24):
            name, info, _, part = struct.unpack_from("<IBBH", data, entry)
            inside = parts[part][0] if 0 < part < len(parts) else ""
            yield text(data, parts[link][2] + name), info & 15, part, inside


def variables(data):
    """Names of the variables of an object in writable sections."""
    for name, kind, part, inside in symbols(data):
        shared = inside.startswith((".bss", ".data")) and not inside.startswith(".data.rel.ro")
        if kind == OBJECT and (shared or part == COMMON):
            yield name


def main():
    """Report every variable that is neither known to be constant nor guarded by a lock, and every vector function."""
    files = [Path(line) for line in Path(sys.argv[1]).read_text().split("\n") if line]
    found = [
        f"{file.name}: {name} is static storage, which threads share"
        for file in files
        for name in variables(file.read_bytes())
        if not (CONSTANT.search(name) or GUARDED.search(name))
    ]
    found += [
        f"{file.name}: {name} has other last bits where registers are wider"
        for file in files
        for name, *_ in symbols(file.read_bytes())
        if name.startswith("_ZGV")
    ]
    print("\n".join(found) or f"{len(files)} objects hold no static storage, and call no vector functions")
    return 1 if found or not files else 0


if __name__ == "__main__":
    sys.exit(main())
