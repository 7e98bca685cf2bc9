# SPDX-License-Identifier: BSD-3-Clause
"""Tests of the stand-in for pFUnit: it refuses, checks and accepts the lines that pFUnit 4.14 refuses, checks and
accepts.

check_funit.py CMAKE COMPILER TRANSLATOR DRIVER INCLUDE_DIR LIBRARY [FLAG]

Every case is a suite of its own, which is translated, compiled and run. Its kind says where it must fail, or that it
must pass."""

import subprocess
import sys
import tempfile
from pathlib import Path

CMAKE, COMPILER, TRANSLATOR, DRIVER, INCLUDE, LIBRARY = sys.argv[1:7]
FLAGS = [flag for flag in sys.argv[7:] if flag]

SUITE = """\
module test_case
   use funit
   use, intrinsic :: iso_fortran_env, only: dp => real64, i8 => int64
   implicit none
   real(dp) :: x(2) = 1, matrix(2, 2) = 1, cube(2, 2, 2) = 1, none(0)
   integer(i8) :: long(2) = 3
   logical :: table(2, 2) = .true.
contains
{before}
   @test
   subroutine test_it()
      {line}
   end subroutine test_it
{after}
end module test_case
"""

# assertions that must not compile
REFUSED_BY_TYPE = [
    "@assertIsNaN(x)",
    "@assertIsFinite(x)",
    "@assertEqual(x, 1.0_dp)",
    "@assertEqual(long, 3_i8)",
    "@assertEqual(['a', 'b'], 'a')",
    "@assertEqual(1.0_dp, 1_i8)",
    "@assertLessThan(x, 2.0_dp)",
    "@assertGreaterThan(long, 2)",
    "@assertTrue(table)",
    "@assertFalse(table)",
    "@assertEqual(matrix, x)",
    "@assertEqual(x, x, tolerance=x)",
]
# lines that the translator must refuse
REFUSED_BY_TEXT = [
    "@assertTrue(.true.) ! a comment",
    "if (x(1) > 0) @assertTrue(.true.)",
    f"@assertTrue(.true.{' .or. .true.' * 12})",
]
# assertions that compile, run and fail
FAILS = [
    "@assertEqual(cube, cube(:, :, :1))",
    "@assertEqual(cube, reshape(cube, [1, 2, 4]))",
    "@assertEqual(['a', 'b'], ['a', 'c'])",
    "@assertEqual(['a', 'b'], ['a'])",
    "@assertEqual('a', ['a', 'b'])",
    "@assertLessThan(x, [2.0_dp, 1.0_dp])",
    "@assertLessThan([0.0_dp], x)",
    "@assertLessThan(0.0_dp, [1.0_dp, 0.0_dp])",
    "@assertLessThanOrEqual(matrix, matrix(:1, :))",
    "@assertGreaterThan(long, [2_i8, 3_i8])",
    "@assertGreaterThanOrEqual(2, long)",
    "@assertEqual(none, x)",
    "@assertEqual(x, none)",
    "@assertEqual(cube(:, :, :0), cube)",
    "@assertEqual(['a'], ['a', 'a'])",
    "@assertEqual(4, long)",
    "@assertEqual(1.0_dp, x + 0.1_dp, 0.01_dp)",
    "@assertEqual(1.0_dp, log(-x))",
    "@assertLessThan(log(-x(1)), 1.0_dp)",
    "@assertTrue([.true., .false.])",
    "@assertFalse([.true., .false.])",
    "@assertEqual('a b', 'ab')",
]
PASSES = [
    "@assertEqual(3, long)",
    "@assertEqual([3, 3], long)",
    "@assertEqual(3, long(1))",
    "@assertEqual(1, x)",
    "@assertLessThan(2, long)",
    "@assertEqual(1.0_dp, x + 0.1_dp, 0.2_dp)",
    "@assertEqual(x, x + 0.1_dp, 0.2_dp, message='positional')",
    "@assertEqual('  a', 'a ')",
    "@assertEqual(['  a', 'b  '], ['a', 'b'])",
    "@assertEqual('a', ['a ', ' a'])",
    "@assertEqual(1.0_dp, none)",
    "@assertTrue([.true., .true.])",
    "@assertEqual(.true., table)",
    "@assertLessThan(0.0_dp, cube)",
    "@assertEqual(cube, cube)",
]

SET_UP_FAILS = {
    "before": "   @before\n   subroutine set_up()\n      @assertTrue(.false.)\n   end subroutine set_up",
    "after": "   @after\n   subroutine tear_down()\n      write (*, '(a)') 'torn down'\n   end subroutine tear_down",
}
TEAR_DOWN = {"before": "", "after": SET_UP_FAILS["after"]}


def outcome(folder: Path, line: str, before: str = "", after: str = "", flags: tuple = ()) -> tuple[str, str]:
    """How the suite with this line ends, and the text that was printed."""
    names = "test_case.pf", "test_case.F90", "test_case_driver.F90", "test_case.inc", "test_case"
    suite, source, driver, suites, executable = (folder / name for name in names)
    suite.write_text(SUITE.format(line=line, before=before, after=after))
    driver.write_text(Path(DRIVER).read_text())
    suites.write_text("ADD_SUITE(test_case_suite)\n")
    translate = [CMAKE, "-D", f"SUITE={suite}", "-D", f"SOURCE={source}", "-P", TRANSLATOR]
    compile_it = [COMPILER, "-O0", "-ffree-line-length-none", *FLAGS, *flags, f"-DSUITE_LIST=<{suites}>"]
    compile_it += [f"-I{INCLUDE}", f"-J{folder}", str(source), str(driver), LIBRARY, "-o", str(executable)]
    for name, command in (
        ("refused by text", translate),
        ("refused by the compiler", compile_it),
        ("fails", [str(executable)]),
    ):
        done = subprocess.run(command, check=False, capture_output=True, text=True)
        if done.returncode != 0:
            return name, done.stdout + done.stderr
    return "passes", done.stdout


def main() -> int:
    """Run every case; the exit code is the number of cases with a wrong end."""
    cases = [(line, {}, "refused by the compiler") for line in REFUSED_BY_TYPE]
    cases += [(line, {}, "refused by text") for line in REFUSED_BY_TEXT]
    cases += [(line, {}, "fails") for line in FAILS]
    cases += [(line, {}, "passes") for line in PASSES]
    for name in ("run", "stub", "fail", "throw"):
        own = f"   subroutine {name}()\n   end subroutine {name}"
        cases.append(("@assertTrue(.true.)", {"before": own}, "refused by the compiler"))
    # a build with the preprocessor off must fail: its driver would hold no suites, and pFUnit's driver would not
    # compile
    cases.append(("@assertTrue(.true.)", {"flags": ("-nocpp",)}, "fails"))
    wrong = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for line, parts, wanted in cases:
            found, said = outcome(folder, line, **parts)
            if found != wanted:
                wrong += 1
                print(f"{line}: {found}, not {wanted}\n{said}")
        _, said = outcome(folder, "@assertTrue(.true.)", **SET_UP_FAILS)
        wrong += "torn down" in said
        _, said = outcome(folder, "@assertTrue(.false.)", **TEAR_DOWN)
        wrong += "torn down" not in said
    print(f"{len(cases) + 2 - wrong} cases as they should be, {wrong} not")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
