# SPDX-License-Identifier: BSD-3-Clause
"""Run a program that sends itself a signal at a given point: no test waits until a process gets there.

    sent_at.py SIGNAL N WORD EVENTS PROGRAM [ARGUMENT..]

The point is the N-th audit event of Python among EVENTS whose path contains WORD. EVENTS are names joined by commas, or
`all` events of files. PROGRAM is `symsde`, the command line, or the text of a program. With N = 0 no signal is sent,
and the number of events is printed at the end.
"""

import atexit
import os
import runpy
import sys

FILES = "open,os.link,os.rename,os.remove,os.mkdir,os.rmdir,os.chmod,os.scandir,os.listdir"
PLACED = "os.link,os.rename"  #: a written file gets its final name


def main() -> None:
    """Run the program."""
    number, at, word, events, program, *arguments = sys.argv[1:]
    wanted = set((FILES if events == "all" else events).split(","))
    seen = 0

    def hook(event, given):
        nonlocal seen
        if event in wanted and any(word in os.fsdecode(x) for x in given if isinstance(x, str | bytes | os.PathLike)):
            seen += 1
            if seen == int(at):
                os.kill(os.getpid(), int(number))

    sys.addaudithook(hook)
    if at == "0":
        atexit.register(lambda: print(seen))
    sys.argv = ["", *arguments]
    if program == "symsde":
        runpy.run_module("symsde", run_name="__main__")
    else:
        exec(compile(program, "program", "exec"), {"__name__": "__main__"})


def words(number, at, word, events, program, *arguments):
    """The command line of such a process."""
    given = (number, at, word, events, program, *arguments)
    return [sys.executable, __file__, *map(str, given)]


if __name__ == "__main__":
    main()
