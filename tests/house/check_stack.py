# SPDX-License-Identifier: BSD-3-Clause
"""check_stack.py LIST: exit 1 where an object or library named in the file LIST asks for an executable stack.

An internal procedure passed as a callback needs one, and hardened systems refuse such libraries. The linker's option -z
noexecstack would only hide the need until the first call crashes; hence this check reads every object."""

import struct
import sys
from pathlib import Path

NOTE, EXECUTABLE_SECTION = b".note.GNU-stack", 4
GNU_STACK, EXECUTABLE_SEGMENT = 0x6474E551, 1
RELOCATABLE = 1


def sections(data):
    """Name and flags of every section of a 64-bit little-endian ELF file."""
    (offset,) = struct.unpack_from("<Q", data, 40)
    size, count, names = struct.unpack_from("<HHH", data, 58)
    headers = [struct.unpack_from("<IIQQQQ", data, offset + index * size) for index in range(count)]
    text = headers[names][4]
    return {data[text + h[0] : data.index(b"\0", text + h[0])]: h[2] for h in headers}


def segments(data):
    """Type and flags of every program header."""
    (offset,) = struct.unpack_from("<Q", data, 32)
    size, count = struct.unpack_from("<HH", data, 54)
    return dict(struct.unpack_from("<II", data, offset + index * size) for index in range(count))


def executable_stack(data):
    """Whether the file asks for an executable stack; a file without a mark does."""
    if data[:6] != b"\x7fELF\x02\x01":
        raise SystemExit("not a 64-bit little-endian ELF file")
    (kind,) = struct.unpack_from("<H", data, 16)
    if kind == RELOCATABLE:
        return bool(sections(data).get(NOTE, EXECUTABLE_SECTION) & EXECUTABLE_SECTION)
    return bool(segments(data).get(GNU_STACK, EXECUTABLE_SEGMENT) & EXECUTABLE_SEGMENT)


def main():
    """Report every file that fails."""
    files = Path(sys.argv[1]).read_text().split("\n")
    found = [file for file in files if file and executable_stack(Path(file).read_bytes())]
    print("\n".join(f"{file}: asks for an executable stack" for file in found) or f"{len(files)} files are sound")
    return 1 if found or not files else 0


if __name__ == "__main__":
    sys.exit(main())
