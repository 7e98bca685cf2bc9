# SPDX-License-Identifier: BSD-3-Clause
"""check_subject.py FILE: exit 1 unless the commit message in FILE has a short subject and a reason below it.

check_subject.py --self-test  a sound message passes, and every planted fault is found

The hook `commit-msg` of .pre-commit-config.yaml calls it (pre-commit install --hook-type commit-msg).
"""

import sys
from pathlib import Path

MOST = 72
SOUND = "Name what a scheme takes of the path\n\nReports did not say which functionals decide the path inside a step.\n"
PLANTED = {
    "has 73 characters": "N" * 73 + SOUND[SOUND.index("\n") :],
    "ends in a full stop": SOUND.replace("path\n", "path.\n", 1),
    "the second line is not empty": SOUND.replace("\n\n", "\n", 1),
    "no reason stands below": "Name what a scheme takes of the path\n\n# On branch main\n",
    "is empty": "# On branch main\n",
}


def findings(message):
    """The faults of a message, as text; comment lines added by git are ignored."""
    lines = [line.rstrip() for line in message.splitlines() if not line.startswith("#")]
    while lines and not lines[-1]:
        lines.pop()
    if not lines or not lines[0]:
        yield "the subject is empty: say in one line what the commit does"
        return
    if lines[0].startswith(("Merge ", "Revert ", "fixup! ", "squash! ")):
        return
    if len(lines[0]) > MOST:
        yield f"the subject has {len(lines[0])} characters, allowed are {MOST}: the reason belongs below it"
    if lines[0].endswith("."):
        yield "the subject ends in a full stop: it is a heading"
    if len(lines) > 1 and lines[1]:
        yield "the second line is not empty: it parts the subject from the reason"
    elif len(lines) < 3:
        yield "no reason stands below the subject: say in plain sentences why"


def self_test():
    """A sound message gives no finding, and every planted fault gives its own finding."""
    wrong = list(findings(SOUND)) + list(findings("Merge branch 'x'\n"))
    for wanted, message in PLANTED.items():
        found = list(findings(message))
        wrong += [] if len(found) == 1 and wanted in found[0] else [f"planted '{wanted}', found {found}"]
    return wrong


def main():
    """Run the check or its self-test."""
    if sys.argv[1] == "--self-test":
        found = self_test()
    else:
        found = list(findings(Path(sys.argv[1]).read_text(encoding="utf-8")))
    print("\n".join(found) or "nothing to report")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
