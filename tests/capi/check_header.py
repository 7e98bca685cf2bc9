# SPDX-License-Identifier: BSD-3-Clause
"""The header, the Fortran sources and the built library agree.

check_header.py ROOT LIBRARY   enum values, functions with their arguments, struct members, exported names
check_header.py --self-test    plants a difference of every kind and requires that each is found

SYMSDE_INCLUDE in the environment names another folder of headers than that of ROOT.
"""

import os
import re
import subprocess
import sys
from pathlib import Path

# a C type that is passed by value, and the Fortran type that interoperates with it
SCALARS = {
    "int": "integer(c_int)",
    "int32_t": "integer(c_int32_t)",
    "int64_t": "integer(c_int64_t)",
    "uint64_t": "integer(c_int64_t)",
    "size_t": "integer(c_size_t)",
    "double": "real(c_double)",
    "char": "character(kind=c_char)",
}
POINTER, FUNCTION = "type(c_ptr)", "type(c_funptr)"
NAMED = {
    "SYMSDE_EVIDENCE_NONE": "evidence_none",
    "SYMSDE_EVIDENCE_CLAIMED": "evidence_claimed",
    "SYMSDE_EVIDENCE_DERIVED": "evidence_derived",
    "SYMSDE_AREAS_PATH": "areas_by_path",
    "SYMSDE_AREAS_LAW": "areas_in_law",
    "SYMSDE_DAMPING_NOISE_LAW": "noise_of_scheme",
    "SYMSDE_DAMPING_NOISE_LAW2": "noise_law2",
    "SYMSDE_DAMPING_NOISE_LAW3": "noise_law3",
    "SYMSDE_DAMPING_NOISE_PATH": "noise_path",
    "SYMSDE_DAMPING_NOISE_POLYNOMIAL": "noise_polynomial",
    "SYMSDE_ON_POSITION": "on_position",
    "SYMSDE_ON_TIME": "on_time",
    "SYMSDE_ON_POSITION_AND_TIME": "on_position_and_time",
    "SYMSDE_CORRECTION_AUTO": "correction_auto",
    "SYMSDE_CORRECTION_NONE": "correction_none",
    "SYMSDE_CORRECTION_MEAN": "correction_mean",
    "SYMSDE_CORRECTION_INCREMENTS": "correction_increments",
}
STATUS_PREFIX = "SYMSDE_"


def plain_c(text):
    """C text without comments and preprocessor lines."""
    text = re.sub(r"/\*.*?\*/", " ", text, flags=re.S)
    return re.sub(r"^\s*#.*$", "", text, flags=re.M)


def plain_fortran(text):
    """Fortran text without comments, continued lines joined, in lower case outside of quotes."""
    text = re.sub(r"^((?:[^'\"!\n]|'[^'\n]*'|\"[^\"\n]*\")*)!.*$", r"\1", text, flags=re.M)
    return re.sub(r"&\s*\n\s*&?", " ", text)


def c_type(words, names):
    """The Fortran type that a C declaration without its name stands for, among handles and callbacks."""
    handles, callbacks = names
    bare = words.replace("const", " ").split()
    if "*" in words:
        return POINTER
    kind = bare[-1] if bare else ""
    if kind in handles:
        return POINTER
    if kind in callbacks:
        return FUNCTION
    return SCALARS.get(kind, f"unknown {words}")


def split_c(declaration, names):
    """Name and type of each variable in a C declaration such as 'const double *q, *p' or 'char name[64]'."""
    first, *more = declaration.split(",")
    match = re.match(r"\s*(.*?)(\w+)\s*((?:\[\w+\])*)\s*$", first, re.S)
    base, found = match[1], [(match[1], match[2], match[3])]
    for item in more:
        match = re.match(r"\s*(\**)\s*(\w+)\s*((?:\[\w+\])*)\s*$", item, re.S)
        found.append((base.replace("*", "") + match[1], match[2], match[3]))
    return [(name, c_type(words, names) + extent.replace("[", "(").replace("]", ")")) for words, name, extent in found]


def read_header(text):
    """(enum values, {function: ['name: type']}, {struct: [(member, type)]}) of the header."""
    sizes = dict(re.findall(r"^#define\s+(\w+)\s+(\d+)\s*$", text, re.M))
    text = plain_c(text)
    for name, value in sizes.items():
        text = re.sub(rf"\b{name}\b", value, text)
    handles = set(re.findall(r"typedef\s+struct\s+\w+\s*\*\s*(\w+)\s*;", text))
    callbacks = set(re.findall(r"typedef\s+int\s*\(\s*\*\s*(\w+)\s*\)", text))
    names = handles, callbacks
    enums = {}
    for body in re.findall(r"\benum\s+\w+\s*\{(.*?)\}", text, re.S):
        enums.update((key, int(value)) for key, value in re.findall(r"(\w+)\s*=\s*(-?\d+)", body))
    functions = {}
    for name, arguments in re.findall(r"^int\s+(symsde_\w+)\s*\(([^)]*)\)\s*;", text, re.M):
        functions[name] = [read_argument(item.strip(), names) for item in arguments.split(",")]
    structs = {}
    for body, name in re.findall(r"typedef\s+struct\s+\w+\s*\{(.*?)\}\s*(\w+)\s*;", text, re.S):
        members = [line for line in body.split(";") if line.strip()]
        structs[name] = [member for line in members for member in split_c(line, names)]
    return enums, functions, structs


def read_argument(declaration, names):
    """'name: type' of a C argument; every pointer has the same Fortran type, so only names tell pointers apart."""
    before, name, extent = re.match(r"(.*?)(\w+)\s*((?:\[\w*\])*)$", declaration, re.S).groups()
    return f"{name}: {POINTER if extent else c_type(before, names)}"


def read_functions(text):
    """{C name: ['name: type']} of the bind(C) functions of one Fortran file."""
    functions = {}
    pattern = r"^ *function\s+(\w+)\(([^)]*)\)([^\n]*)bind\(c,\s*name='(symsde_\w+)'\)(.*?)^ *end function\s+\1"
    for _, arguments, _, name, body in re.findall(pattern, text, re.M | re.S):
        types = {}
        for kind, attributes, declared in re.findall(
            r"^ *((?:integer|real|type|character)\([^)]*\))([^:\n]*)::([^\n]*)$", body, re.M
        ):
            value = re.search(r"\bvalue\b", attributes)
            for item in re.split(r",\s*", declared.strip()):
                types.setdefault(item, kind if value else f"{kind} by reference")
        named = [item.strip() for item in arguments.split(",")]
        functions[name] = [f"{item}: {types.get(item, 'undeclared')}" for item in named]
    return functions


def read_structs(text, sizes):
    """{type name: [(member, type)]} of the bind(C) types of one Fortran file."""
    structs = {}
    for name, body in re.findall(r"^ *type, bind\(c\) :: c_(\w+)\n(.*?)^ *end type", text, re.M | re.S):
        members = []
        for kind, declared in re.findall(r"^ *(\w+\([^)]*\)) :: ([^\n]*)$", body, re.M):
            for item in re.split(r",\s*", declared.strip()):
                match = re.match(r"(\w+)(?:\((\w+)\))?(?: = \S+)?$", item)
                extent = f"({sizes.get(match[2], match[2])})" if match[2] else ""
                members.append((match[1], kind + extent))
        structs[name] = members
    return structs


def read_sources(root):
    """(parameters, enumerators and sizes; functions; structs) of the Fortran sources."""
    values, functions, structs = {}, {}, {}
    files = [
        root / "src/base/area_rule.f90",
        root / "src/base/damping.f90",
        root / "src/base/status.f90",
        root / "src/noise/states.f90",
        root / "src/scheme/scheme.f90",
        root / "src/scheme/orders.f90",
        root / "src/ensemble/observe/moment_collector.f90",
        root / "src/ensemble/observe/observers.f90",
    ]
    capi = [*sorted((root / "src/capi").glob("*.f90")), root / "src/model/user/path_parameters.f90"]
    for file in files + capi:
        text = plain_fortran(file.read_text(encoding="utf-8"))
        values.update(
            (name, int(value))
            for name, value in re.findall(
                r"^ *(?:integer(?:\(i4\))?, parameter|enumerator) :: (\w+) = (-?\d+) *$", text, re.M
            )
        )
    for file in capi:
        text = plain_fortran(file.read_text(encoding="utf-8"))
        functions.update(read_functions(text))
        structs.update(read_structs(text, values))
    return values, functions, structs


def exported(library):
    """The C names that the library exports and that begin with symsde_."""
    lines = subprocess.run(["nm", "-D", "--defined-only", library], check=True, capture_output=True, text=True).stdout
    return set(re.findall(r" [TW] (symsde_\w+)$", lines, re.M))


def differences(header, sources, names):
    """Every difference, as a line of text."""
    enums, functions, structs = header
    values, fortran_functions, fortran_structs = sources
    for name, value in enums.items():
        low = NAMED.get(name, name.removeprefix(STATUS_PREFIX).lower())
        low = "status_ok" if name == "SYMSDE_OK" else low
        if values.get(low) != value:
            yield f"{name} = {value} in the header, {low} = {values.get(low)} in the sources"
    statuses = [name for name in enums if name not in NAMED]
    if len(statuses) < 10 or len(functions) < 30 or len(structs) < 8:
        yield f"only {len(statuses)} codes, {len(functions)} functions, {len(structs)} structs found in the header"
    for name in sorted(functions.keys() | fortran_functions.keys() | names):
        if name not in functions:
            yield f"{name} is not in the header"
        elif name not in names:
            yield f"{name} is not exported by the library"
        elif functions[name] != fortran_functions.get(name):
            yield f"{name} takes {functions[name]} in the header, {fortran_functions.get(name)} in the sources"
    for name in sorted(structs.keys() | {f"symsde_{key}" for key in fortran_structs}):
        here, there = structs.get(name), fortran_structs.get(name.removeprefix("symsde_"))
        if here != there:
            yield f"struct {name} is {here} in the header, {there} in the sources"


def self_test(root, library):
    """The sources as they are give no difference, and every planted difference is found."""
    text = (root / "include/symsde.h").read_text(encoding="utf-8")
    sources, names = read_sources(root), exported(library)
    planted = {
        "SYMSDE_TOO_LARGE": ("SYMSDE_TOO_LARGE = -5", "SYMSDE_TOO_LARGE = -50"),
        "SYMSDE_EVIDENCE_CLAIMED": ("SYMSDE_EVIDENCE_CLAIMED = 1", "SYMSDE_EVIDENCE_CLAIMED = 2"),
        "SYMSDE_CORRECTION_MEAN": ("SYMSDE_CORRECTION_MEAN = 2", "SYMSDE_CORRECTION_MEAN = 3"),
        "symsde_increments takes": ("const symsde_options *options, double *dw,", "double *dw,"),
        "symsde_model_gradient takes": ("double *hq, double *hp, symsde_error", "double *hp, double *hq, symsde_error"),
        "symsde_model_probe takes": ("symsde_model_probe(symsde_model model, double t,",
                                     "symsde_model_probe(symsde_model model, float t,"),
        "symsde_scheme_names is not in": ("int symsde_scheme_names(", "int renamed_scheme_names("),
        "symsde_extra is not exported": ("int symsde_version(", "int symsde_extra(int a);\nint symsde_version("),
        "struct symsde_options": ("int32_t lanes; ", "int64_t lanes; "),
        "struct symsde_paths": ("double *q, *p; ", "double *p, *q; "),
        "struct symsde_error": ("#define SYMSDE_MESSAGE_SIZE 1024", "#define SYMSDE_MESSAGE_SIZE 1000"),
        "struct symsde_moments": ("SYMSDE_MAX_FAILED_LISTED 1000", "SYMSDE_MAX_FAILED_LISTED 999"),
    }  # fmt: skip
    for wanted, (old, new) in planted.items():
        changed = text.replace(old, new, 1)
        found = list(differences(read_header(changed), sources, names))
        if changed == text or not any(wanted in line for line in found):
            yield f"planted '{new}', found {found}"


def main():
    """Run the check or its self-test."""
    root, library = Path(sys.argv[-2]), sys.argv[-1]
    include = Path(os.environ.get("SYMSDE_INCLUDE", root / "include"))
    if sys.argv[1] == "--self-test":
        found = list(self_test(root, library))
    else:
        header = read_header((include / "symsde.h").read_text(encoding="utf-8"))
        found = list(differences(header, read_sources(root), exported(library)))
        print(f"{len(header[0])} codes, {len(header[1])} functions, {len(header[2])} structs")
    print("\n".join(found) if found else "nothing to report")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
