# SPDX-License-Identifier: BSD-3-Clause
"""The Fortran reference: what `use symsde` brings, with the comments of the sources."""

import re

from plain import as_markdown

INTRODUCTION = """\
# Fortran interface

`use symsde` is all that a program needs. This page is made from the sources when the site is built: a comment `!>`
stands before what it describes, a comment `!!` behind an argument or a component. The path (or lane) is the first index
of every array: `q(npath, ndof, ntime)`. Every procedure that can fail has an argument `error`. If it is allocated on
return, nothing was computed, and `error%message` says why. [First ten minutes](../first-ten-minutes.md) and
[a model of your own](../own-model.md) have complete programs; [status codes](../errors.md) explains every code.
"""
USE = re.compile(r"^   use (\w+), only: ((?:.*&\n)*.*)$", re.M)


def page(root):
    """The page; ValueError where something that the facade brings is not found in its module."""
    modules = {_module(path): path for path in sorted((root / "src").rglob("*.f90*"))}
    facade = modules["symsde"].read_text(encoding="utf-8").partition("\nmodule symsde\n")[2]
    found, group, constants = [INTRODUCTION], [], []
    for line in _logical(facade):
        comment = re.match(r"   ! (.*)", line)
        use = USE.match(line)
        if comment:
            if not group:
                group = [comment[1]]
            else:
                group.append(comment[1])
        elif use:
            if group:
                found += [*_table(constants), _group(group)]
                group, constants = [], []
            for name in re.split(r",\s*", re.sub(r"&\n\s*", "", use[2])):
                public, _, private = (part.strip() for part in name.partition("=>"))
                constant = _constant(public, private or public, modules[use[1]])
                if not constant:
                    found += [*_table(constants), _entry(public, private or public, use[1], modules[use[1]], root)]
                    constants = []
                else:
                    constants.append(constant)
    return "\n".join([*found, *_table(constants)])


def _constant(public, private, path):
    """The row of a constant: name, value, meaning; None for anything else."""
    text = path.read_text(encoding="utf-8")
    code, comment = _line(private, text) or ("", "")
    value = re.search(rf"\b{private} *= *([^,!&\n]+)", code)
    if not value:
        return None
    behind = re.search(r"!! *(.*)", code) or re.search(rf"case \({private}\); text = '([^']*)'", text)
    meaning = comment or (behind[1] if behind and code.count("=") == 1 else "")
    return f"| `{public}` | `{value[1].strip()}` | {as_markdown(meaning).strip()} |"


def _table(constants):
    """Constants that stand together in the facade, as one table."""
    return ["| constant | value | meaning |\n|---|---|---|\n" + "\n".join(constants) + "\n"] * bool(constants)


def _module(path):
    found = re.search(r"^module (\w+)", path.read_text(encoding="utf-8"), re.M)
    return found[1] if found else path.as_posix()


def _logical(text):
    """Lines with their continuations."""
    return re.findall(r"^(?:.*&\n)*.*\n", text, re.M)


def _group(comments):
    """A heading from the comment over a group of the facade, with what else it says."""
    title, *rest = " ".join(comments).split(": ", 1)
    if re.match(r"\w+\(", title):
        return ""  # of one procedure, whose own comment says it
    return f"## {title[:60].split('(')[0].strip().capitalize()}\n\n" + as_markdown(rest[0] if rest else "")


def _entry(public, private, module, path, root):
    text = path.read_text(encoding="utf-8")
    code, comment = _procedure(private, text) or _type(private, text) or _line(private, text) or (None, None)
    if code is None:
        raise ValueError(f"{path}: {private}, which the facade brings, is not found")
    renamed = "" if public == private else f" (there `{private}`)"
    where = f"Module `{module}`{renamed}, {path.relative_to(root).as_posix()}."
    return f"### `{public}`\n\n{as_markdown(comment)}\n```fortran\n{code}\n```\n\n{where}\n"


def _comment(text, start):
    """The block of `!>` that ends where a definition starts."""
    lines = []
    for line in reversed(text[:start].splitlines()):
        if not re.match(r"\s*!>", line):
            break
        lines.append(re.sub(r"^\s*!> ?", "", line))
    return "\n".join(reversed(lines))


def _procedure(name, text):
    """Heading and declarations of the arguments of a procedure, or of all that a generic name stands for."""
    head = rf"^ *(?:(?:pure|elemental|impure|recursive) )*(?:subroutine|function) {name}\b(?:.*&\n)*.*\n"
    found = re.search(head, text, re.M)
    if found:
        rest = text[found.end() :]
        until = re.search(r"^ *end (?:subroutine|function)", rest, re.M).start()
        words = re.findall(r"\w+", found[0].partition("(")[2])
        kept = [line for line in _logical(rest[:until]) if _declares(line, words)]
        return _dedented(found[0] + "".join(kept)), _comment(text, found.start())
    generic = re.search(rf"^ *interface {name}\n(.*?)^ *end interface", text, re.M | re.S)
    if generic:
        parts = [_procedure(part, text) for part in re.findall(r"\w+", generic[1].replace("module procedure", ""))]
        parts = [part for part in parts if part]
        comment = _comment(text, generic.start()) or "\n".join(part[1] for part in parts)
        return "\n\n".join(part[0] for part in parts), comment
    return None


def _declares(line, words):
    """A line that declares an argument or the result."""
    names = re.search(r"::\s*([^!]*)", line)
    return bool(names) and any(name in words for name in re.findall(r"\w+", re.sub(r"\([^)]*\)", "", names[1])))


def _type(name, text):
    """A type; of an abstract one the procedures that users override, too."""
    found = re.search(rf"^ *type(?:, [^:\n]*)? *(?:::)? *{name}\n.*?^ *end type\b[^\n]*$", text, re.M | re.S)
    if not found:
        return None
    parts = [_dedented(found[0])]
    if re.match(r" *type, abstract", found[0]):
        names = re.findall(r"procedure\((\w+)\)", found[0]) + re.findall(r"procedure :: \w+ => (\w+)", found[0])
        for binding in filter(None, (_procedure(binding, text) for binding in names)):
            parts.append("\n".join([*(f"!> {line}" for line in binding[1].splitlines()), binding[0]]))
    return "\n\n".join(parts), _comment(text, found.start())


def _line(name, text):
    """A parameter, with its line."""
    for line in _logical(text):
        if re.search(rf"(?:parameter|enumerator)\b.*::(?:.*\W)?{name}\b", line, re.S):
            start = text.index(line)
            return _dedented(line), _comment(text, start)
    return None


def _dedented(code):
    lines = code.rstrip().splitlines()
    margin = min(len(line) - len(line.lstrip()) for line in lines if line.strip())
    return "\n".join(line[margin:] for line in lines)
