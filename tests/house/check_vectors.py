# SPDX-License-Identifier: BSD-3-Clause
"""check_vectors.py COMPILER MODULES ROOT|--self-test: exit 1 where a kernel marked VEC is not vectorised.

A procedure whose header comment has a line that begins with the word VEC is a kernel: the compiler must report each
of its innermost loops as vectorised, for AVX2 and for AVX-512 machines.
A loop after `!GCC$ unroll` is unrolled before vectorisation, so the loop around it counts. A loop after `!GCC$
novector` does not count: the steps of a single path, each of which needs the step before. MODULES holds the module
files of a build. A file is compiled for the report only: -dx stops before instructions are written. A body (.inc)
counts in each module that includes it, except in modules for a single path, which have no loops over lanes."""

import re
import subprocess
import sys
import tempfile
from pathlib import Path

from bodies import expanded

SINGLE_PATH = "_single_path.f90"

FLAGS = ["-O3", "-fno-trapping-math", "-fno-math-errno", "-fopenmp", "-fPIC", "-fopt-info-vec-optimized", "-S", "-dx"]
TARGETS = (
    ["-march=x86-64-v3", "-ffp-contract=fast"],
    ["-march=x86-64-v4", "-ffp-contract=fast"],
)
#: Flags of single files, as in src/CMakeLists.txt.
INLINE = ["--param=max-inline-insns-auto=200"]
OWN = {
    "noise/philox.f90": ["-fwrapv"], "flows/oscillator.f90": INLINE, "flows/damped_oscillator.f90": INLINE,
}  # fmt: skip
MARK = re.compile(r"\s*!> ?VEC\b")
HEAD = re.compile(r"\s*(?:pure |elemental )*(?:subroutine|function) (\w+)", re.IGNORECASE)
END = re.compile(r"\s*end (?:subroutine|function)\b", re.IGNORECASE)
DO = re.compile(r"\s*do\b(?! while)", re.IGNORECASE)
END_DO = re.compile(r"\s*end do\b", re.IGNORECASE)
UNROLL = re.compile(r"\s*!GCC\$ unroll\b", re.IGNORECASE)
NOVECTOR = re.compile(r"\s*!GCC\$ novector\b", re.IGNORECASE)

PLANTED = """\
module planted
   implicit none
contains
   !> VEC
   pure subroutine vector(n, x)
      integer, intent(in) :: n
      real(8), intent(inout) :: x(n)
      integer :: i
      do i = 1, n
         x(i) = 2*x(i) + 1
      end do
   end subroutine vector
   !> VEC
   pure subroutine written_out(n, x)
      integer, intent(in) :: n
      real(8), intent(inout) :: x(n)
      integer :: i, j
      do i = 1, n
         !GCC$ unroll 4
         do j = 1, 4
            x(i) = j*x(i) + 1
         end do
      end do
   end subroutine written_out
   !> VEC
   pure subroutine excused(n, x)
      integer, intent(in) :: n
      real(8), intent(inout) :: x(n)
      integer :: i
      !GCC$ novector
      do i = 2, n
         x(i) = 1/(x(i) + x(i - 1))
      end do
      do i = 1, n
         x(i) = 2*x(i) + 1
      end do
   end subroutine excused
   !> VEC Each number waits for the one before it.
   pure subroutine scalar(n, x)
      integer, intent(in) :: n
      real(8), intent(inout) :: x(n)
      integer :: i
      do i = 2, n
         x(i) = 1/(x(i) + x(i - 1))
      end do
   end subroutine scalar
end module planted
"""


def kernels(text):
    """Name and innermost loops (first and last line) of every marked procedure."""
    found, marked, name, stack, loops, previous = [], False, None, [], [], ""
    for number, line in enumerate(text.splitlines(), 1):
        if name is None:
            marked = marked or bool(MARK.match(line))
            head = HEAD.match(line)
            if head and marked:
                name, stack, loops = head[1], [], []
            elif not line.lstrip().startswith("!"):
                marked = False
        elif END.match(line):
            found.append((name, loops))
            name, marked = None, False
        elif END_DO.match(line):
            first, innermost = stack.pop()
            if innermost:
                loops.append((first, number))
        elif DO.match(line) and (UNROLL.match(previous) or NOVECTOR.match(previous)):
            stack.append((number, False))
        elif DO.match(line):
            stack = [(first, False) for first, _ in stack] + [(number, True)]
        previous = line
    return found


def vectorised(compiler, target, modules, source):
    """Lines of the source, with its bodies in place, at which the compiler reports a vectorised loop."""
    with tempfile.TemporaryDirectory() as scratch:
        whole = Path(scratch) / source.name
        whole.write_text(expanded(source), encoding="utf-8")
        output = ["-I", modules, "-J", scratch, "-o", f"{scratch}/out.s"]
        command = [compiler, *FLAGS, *target, *OWN.get("/".join(source.parts[-2:]), []), *output, str(whole)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(done.stderr)
    return {int(n) for n in re.findall(r":(\d+):\d+: optimized: +loop vectorized", done.stderr)}


def failures(compiler, modules, source):
    """One line for every kernel loop that was not vectorised, and the number of loops checked."""
    marked = [] if source.name.endswith(SINGLE_PATH) else kernels(expanded(source))
    lines, count = [], 0
    for target in TARGETS if marked else ():
        report = vectorised(compiler, target, modules, source)
        for name, loops in marked:
            if not loops:
                lines.append(f"{source}: {name} is marked VEC and has no loop")
            for first, last in loops:
                count += 1
                if not any(first <= line <= last for line in report):
                    lines.append(f"{source}:{first}: {name} is not vectorised with {' '.join(target)}")
    return lines, count


def self_test(compiler, modules):
    """The planted scalar loop must be found once for each target, and nothing else."""
    with tempfile.TemporaryDirectory() as scratch:
        source = Path(scratch) / "planted.f90"
        source.write_text(PLANTED, encoding="utf-8")
        lines, count = failures(compiler, modules, source)
    good = count == 4 * len(TARGETS) and len(lines) == len(TARGETS) and all(": scalar " in line for line in lines)
    print("\n".join(lines))
    return 0 if good else 1


def main():
    """Check every source file."""
    compiler, modules, where = sys.argv[1:4]
    if where == "--self-test":
        return self_test(compiler, modules)
    found, total = [], 0
    for source in sorted((Path(where) / "src").rglob("*.f90")):
        lines, count = failures(compiler, modules, source)
        found += lines
        total += count
    print("\n".join(found) or f"{total} loops are vectorised")
    return 1 if found or total == 0 else 0


if __name__ == "__main__":
    sys.exit(main())
