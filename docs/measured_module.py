# SPDX-License-Identifier: BSD-3-Clause
"""src/scheme/measured.f90 from docs/measured.json and damping_orders.json: what certificates say of measurements."""

import json
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
DATA = ROOT / "docs" / "measured.json"
DAMPED = ROOT / "docs" / "damping_orders.json"
TARGET = ROOT / "src" / "scheme" / "measured.f90"
CLASSES = {
    "additive": "additive_noise",
    "commutative": "commutative_noise",
    "general": "general_noise",
    "commuting": "commuting_flows",
    "weak": "weak_order",
}

HEAD = """\
! SPDX-License-Identifier: BSD-3-Clause
!> Orders as they were measured, of the schemes of the catalogue. Written by docs/generate.py from docs/measured.json,
!> the work of docs/measure_orders.py, and docs/damping_orders.json, that of docs/damping_orders.py; do not edit.
module symsde_scheme_measured
   use symsde_base_kinds, only: wp
   use symsde_base_text, only: name_length
   use symsde_scheme_orders, only: order_type, norder, additive_noise, commutative_noise, general_noise, &
                                   commuting_flows, weak_order
   implicit none
   private
   public :: add_measurements

   type :: measurement
      character(len=name_length) :: scheme
      integer :: class            !! class of the noise, or weak
      character(len=26) :: problem
      real(wp) :: order
      real(wp) :: half_width      !! half of the 95 % interval; for weak orders, difference of the last two slopes
      real(wp) :: floor           !! error of the reference over the smallest error that counts
   end type measurement

   !> Strong orders with one rate of damping, with additive noise and with noise in position; 0: refused.
   type :: damped_measurement
      character(len=name_length) :: scheme
      real(wp) :: order(2)
   end type damped_measurement

"""
TAIL = """\

contains

   !> Enter the measurements of a scheme of the catalogue into its orders.
   pure subroutine add_measurements(order, damped_order, name)
      type(order_type), intent(inout) :: order(norder)
      real(wp), intent(inout) :: damped_order(2)
      character(*), intent(in) :: name
      integer :: i

      do i = 1, size(found)
         if (found(i)%scheme /= name) cycle
         associate (o => order(found(i)%class))
            o%problem = found(i)%problem
            o%measured = found(i)%order
            o%half_width = found(i)%half_width
            o%floor = found(i)%floor
         end associate
      end do
      do i = 1, size(damped)
         if (damped(i)%scheme == name) damped_order = damped(i)%order
      end do
   end subroutine add_measurements

end module symsde_scheme_measured
"""


def module() -> str:
    """Text of the module; one parameter for each class of noise keeps statements short."""
    data = json.loads(DATA.read_text(encoding="utf-8"))
    text = [HEAD]
    column = " " * 35  # where fprettify aligns what follows a bracket
    for kind, constant in CLASSES.items():
        rows = [(name, found[kind]) for name, found in data.items() if kind in found]
        text.append(f"   type(measurement), parameter :: {kind}({len(rows)}) = [ &\n")
        for i, (name, row) in enumerate(rows):
            numbers = ", ".join(f"{float(row[key])!r}_wp" for key in ("order", "half_width", "floor"))
            end = "]" if i == len(rows) - 1 else ","
            text.append(f"{column}measurement('{name}', {constant}, '{row['problem']}', &\n")
            text.append(f"{column}            {numbers}){end}")
            text.append("\n" if end == "]" else " &\n")
    text.append(f"   type(measurement), parameter :: found(*) = [{', '.join(CLASSES)}]\n")
    damped = _damped()
    text.append(f"   type(damped_measurement), parameter :: damped({len(damped)}) = [ &\n")
    for i, (name, orders) in enumerate(damped.items()):
        end = "]\n" if i == len(damped) - 1 else ", &\n"
        numbers = ", ".join(f"{x!r}_wp" for x in orders)
        text.append(f"{column}       damped_measurement('{name}', [{numbers}]){end}")
    return "".join(text) + TAIL


def _damped() -> dict[str, list[float]]:
    """Orders with one rate of the schemes that run, with additive noise and with noise in position; 0: refused."""
    found = json.loads(DAMPED.read_text(encoding="utf-8"))
    rows = {name: [0.0 if isinstance(x, str) else x for x in of["one rate"].values()] for name, of in found.items()}
    return {name: orders for name, orders in rows.items() if any(orders)}


def write() -> None:
    """Write the module."""
    TARGET.write_text(module(), encoding="utf-8")
