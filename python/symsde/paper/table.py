# SPDX-License-Identifier: BSD-3-Clause
"""The printed table: one block an experiment, one line an expectation, with the paper's equation numbers."""

VERDICTS = {True: "ok", False: "FAILED", None: "-"}
HEADER = ("equations", "quantity", "measured", "expected", "verdict")
WIDTHS = (16, 50, 20, 26, 7)


def print_block(experiment, seconds):
    """One experiment."""
    print(f"\n{experiment.title}   [{seconds:.1f} s]")
    _line(HEADER)
    _line(["-" * width for width in WIDTHS])
    for check in experiment.checks:
        _line((check.equations, check.quantity, check.measured, check.expected, VERDICTS[check.passed]))


def print_summary(experiments, directory, seconds):
    """Counts, and where the files are."""
    verdicts = [check.passed for experiment in experiments for check in experiment.checks]
    print(f"\nwritten to {directory}: results.json and the figures; {seconds:.0f} s")
    print(f"{verdicts.count(True)} expectations met, {verdicts.count(False)} failed")


def _line(cells):
    print(
        "  " + "  ".join(str(cell).ljust(width) for cell, width in zip(cells, WIDTHS, strict=True)).rstrip(), flush=True
    )
