# SPDX-License-Identifier: BSD-3-Clause
"""The program in Fortran: a module with the model, and a main program."""

from __future__ import annotations

from ..errors import InvalidArgumentError
from ..model.formulas.emit_c import VECTORS
from ..model.traits import FLAGS
from . import sites_in_fortran
from .expressions import Expressions, called, wrapped
from .given import Given, columns, entries, equal, supports

WIDTH = 118
BLOCKS = {"value": ("value",), "gradient": ("hq", "hp"), "hessian": ("hqq", "hqp", "hpp")}
THIRD = {"third_derivative": ("tq", "tp")}
CALLED = {"tq": "uq", "tp": "up"}  #: output -> its name in the library's interface
ABOUT = {
    "value": "S = sum_j w_j H_j, lane by lane: one lane is one path",
    "gradient": "S_q and S_p; what is absent is not wanted",
    "hessian": "S_qq, S_qp and S_pp; hqp(:, i, j) = d2 S/(dq_i dp_j)",
    "third_derivative": "The gradient of a^T (the Hessian) b",
}
#: functions of x that Fortran lacks
FUNCTIONS = {
    "sech": ["y = 2/(exp(x) + exp(-x))"],
    "csch": ["y = 1/sinh(x)"],
    "coth": ["y = 1/tanh(x)"],
    "gauss": ["y = exp(-x**2)"],
    "log1p": ["y = x", "if (abs((1 + x) - 1) > 0) y = log(1 + x)*(x/((1 + x) - 1))"],
    "logcosh": ["y = log(cosh(x))", "if (abs(x) > 1) y = abs(x) - log(2.0_wp) + log(1 + exp(-2*abs(x)))"],
    "loggamma": ["y = log_gamma(x) + 0*sqrt(x)  ! no number below zero"],
}
#: functions of a whole order and x that Fortran lacks: declarations and statements
OF_ORDER = {
    "besseli": """\
real(wp) :: ratio, rest
integer :: k

! The ratios I_k/I_(k-1) of high orders first, and exp(x) = I_0 + 2 (I_1 + I_2 + ..)
ratio = 0
rest = 0
y = 1
do k = order + 20 + int(9*sqrt(min(abs(x), 800.0_wp))), 1, -1
   ratio = 1/(2*k/abs(x) + ratio)
   rest = ratio*(1 + rest)
   if (k <= order) y = y*ratio
end do
y = exp(abs(x)/2)/(1 + 2*rest)*y*exp(abs(x)/2)
if (modulo(order, 2) == 1 .and. x < 0) y = -y""",
    "besselk": """\
real(wp) :: step, more, term, next, after
integer :: j

! K_0 and K_1 as integrals of exp(-x cosh(s)) and of cosh(s) exp(-x cosh(s)) by trapezoids, then by recurrence
step = min(0.2_wp, 0.6_wp/sqrt(x))
y = 0.5_wp
next = 0.5_wp
do j = 1, 4000
   more = 2*sinh(step*j/2)**2
   term = exp(-x*more)
   y = y + term
   next = next + term*(1 + more)
   if (x*more > 45) exit
end do
y = y*step*exp(-x)
next = next*step*exp(-x)
do j = 1, order
   after = y + 2*j/x*next
   y = next
   next = after
end do""",
    "polygamma": """\
real(wp), parameter :: pi = acos(-1.0_wp), bernoulli(8) = [real(wp) :: 1/6.0_wp, -1/30.0_wp, 1/42.0_wp, &
   -1/30.0_wp, 5/66.0_wp, -691/2730.0_wp, 7/6.0_wp, -3617/510.0_wp]
real(wp) :: s, c, slope
integer :: j

! By recurrence up to 16, from there on by the asymptotic series, below 1/2 by the reflection
s = merge(1 - x, x, x < 0.5_wp)
y = 0
do while (s < 16)
   y = y + gamma(order + 1.0_wp)/s**(order + 1)
   s = s + 1
end do
y = y + 0.5_wp*gamma(order + 1.0_wp)/s**(order + 1)
do j = 8, 1, -1
   y = y + bernoulli(j)*gamma(2.0_wp*j + order)/gamma(2.0_wp*j + 1)/s**(2*j + order)
end do
if (order == 0) y = log(s) - y
if (order > 0) y = -(-1)**order*(y + gamma(real(order, wp))/s**order)
if (x >= 0.5_wp) return
c = 1/tan(pi*x)
slope = c
if (order == 1) slope = -pi*(1 + c**2)
if (order == 2) slope = 2*pi**2*c*(1 + c**2)
if (order == 3) slope = -2*pi**3*(1 + c**2)*(1 + 3*c**2)
y = (-1)**order*y - pi*slope""",
}
#: members of symsde_options -> components of run_options
OPTIONS = {"steps": "nstep", "paths": "npath"}
_LONG = ("steps", "paths", "seed", "save_every", "first_path", "first_step")
_LOGICAL = ("compensated", "general")


def source(given: Given, compile_line: str) -> str:
    """The text of the whole file."""
    if given.is_chain and given.model._chain.outer is not None:
        raise InvalidArgumentError("functions of sums over sites are exported to C only: say --to c")
    lines = [*(f"!> {line}".rstrip() for line in given.title), "!>", f"!>    {compile_line}"]
    if given.model is not None:
        lines += _module(given)
    return "\n".join([*lines, *_program(given)]) + "\n"


def _module(given: Given) -> list[str]:
    kinds = sites_in_fortran.PROCEDURES if given.is_chain else [*BLOCKS, *(THIRD if given.third else ())]
    lines = [f"module formula_of_{given.stem}", "   use symsde, only: wp, model_type", "   implicit none", "   private"]
    lines += ["   public :: formula_model", "", "   type, extends(model_type) :: formula_model"]
    lines += [line for x, v in given.parameters.items() for line in _parameter(given.identifiers[x], v)]
    lines += [
        "   contains",
        *(f"      procedure :: {kind} => weighted_{kind}" for kind in kinds),
        "   end type formula_model",
        "",
        "contains",
    ]
    for kind in kinds:
        if given.is_chain:
            lines += ["", *sites_in_fortran.procedure(given, kind, WIDTH, _number)]
        else:
            lines += ["", *_procedure(given, kind)]
    for name in called(given, FUNCTIONS):
        lines += [
            "",
            f"   elemental function {name}(x) result(y)",
            "      real(wp), intent(in) :: x",
            "      real(wp) :: y",
        ]
        lines += ["", *(f"      {line}" for line in FUNCTIONS[name]), f"   end function {name}"]
    for name in called(given, OF_ORDER):
        lines += ["", f"   pure function {name}(order, x) result(y)", "      integer, intent(in) :: order"]
        lines += ["      real(wp), intent(in) :: x", "      real(wp) :: y"]
        lines += [f"      {line}".rstrip() for line in OF_ORDER[name].splitlines()] + [f"   end function {name}"]
    return [*lines, "", f"end module formula_of_{given.stem}", ""]


def _parameter(name: str, value: float | tuple[float, ...]) -> list[str]:
    """A component of the type of the model; numbers of all sites are an array."""
    if not isinstance(value, tuple):
        return [f"      real(wp) :: {name} = {_number(value)}"]
    given = _number(value[0]) if equal(value) else _array(value)
    return wrapped(f"      real(wp) :: {name}({len(value)}) = {given}", WIDTH, " " * 9, " &")


def _procedure(given: Given, kind: str) -> list[str]:
    n, optional = given.model.ndof, "" if kind in ("value", *THIRD) else ", optional"
    names = (BLOCKS | THIRD)[kind]
    vectors = VECTORS.get(names, ())
    outputs = [CALLED.get(x, x) for x in names]
    arguments = ", ".join((*vectors, *outputs))
    shape = {"value": "(nlane)", "hessian": "(nlane, ndof, ndof)"}.get(kind, "(nlane, ndof)")
    blocks = [_block(given, kind, block, n) for block in names]
    most = max(count for count, _ in blocks)
    lines = [f"   !> {ABOUT[kind]}"]
    lines += [f"   subroutine weighted_{kind}(self, nlane, ndof, nnoise, t, w, q, p, {arguments})"]
    lines += ["      class(formula_model), intent(in) :: self", "      integer, intent(in) :: nlane, ndof, nnoise"]
    lines += ["      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)"]
    lines += [f"      real(wp), intent(in), dimension(nlane, ndof) :: {', '.join(vectors)}"] if vectors else []
    lines += [f"      real(wp), intent(out){optional} :: {', '.join(x + shape for x in outputs)}"]
    if most:
        lines += wrapped(f"      real(wp) :: {', '.join(f'x{k + 1}' for k in range(most))}", WIDTH, " " * 9, " &")
    lines += ["      integer :: i", ""]
    for _, body in blocks:
        lines += body
    return [*lines, f"   end subroutine weighted_{kind}"]


def _block(given: Given, kind: str, block: str, n: int) -> tuple[int, list[str]]:
    """Write one output: the number of named parts, and its loop over the lanes."""
    made = given.model._derivatives
    names = list(given.identifiers.values())

    def leaf(name: str) -> str:
        letter = name.rstrip("0123456789")
        number = int(name[len(letter) :] or 0)
        if letter == "c":
            return f"self%{names[number]}"
        return "t" if letter == "t" else f"w(i, {number})" if letter == "w" else f"{letter}(i, {number + 1})"

    text = Expressions(made.graph, (made.outputs | given.third)[block], leaf, _number)
    body = [f"{name} = {value}" for name, value in text.parts]
    places = {
        "value": lambda k: "i",
        "gradient": lambda k: f"i, {k + 1}",
        "third_derivative": lambda k: f"i, {k + 1}",
        "hessian": lambda k: f"i, {k % n + 1}, {k // n + 1}",
    }
    body += [f"{CALLED.get(block, block)}({places[kind](k)}) = {value}" for k, value in enumerate(text.results)]
    whole = kind in ("value", *THIRD)
    indent = " " * (6 if whole else 9)
    lines = [f"{indent}do i = 1, nlane"]
    for statement in body:
        lines += wrapped(f"{indent}   {statement}", WIDTH, indent + " " * 6, " &")
    lines += [f"{indent}end do"]
    if not whole:
        lines = [f"      if (present({block})) then", *lines, "      end if"]
    return len(text.parts), lines


def _program(given: Given) -> list[str]:
    n = len(given.q0)
    own = [f"   use formula_of_{given.stem}, only: formula_model"] if given.model is not None else []
    kind = "type(formula_model)" if given.model is not None else "class(model_type), allocatable"
    lines = [f"program run_of_{given.stem}", "   use symsde", *own, "   implicit none", "", f"   {kind} :: model"]
    lines += ["   type(scheme_type) :: scheme", "   type(run_options) :: options", "   type(moments_type) :: averages"]
    lines += ["   type(error_type), allocatable :: error", "   integer :: i, k", "", *_model(given)]
    lines += [f"   call get_scheme(scheme, '{given.scheme}', error)"]
    lines += [f"   options%{OPTIONS.get(x, x)} = {_option(x, v)}" for x, v in given.options.items()]
    lines += [f"   call moments(model, scheme, options, q0={_state(given.q0)}, p0={_state(given.p0)}, &"]
    lines += ["                result=averages, error=error)", "   if (allocated(error)) then"]
    lines += ["      print '(a)', error%message", "      stop 1", "   end if", ""]
    lines += [f"   print '(a)', '# t, then the mean and its standard error of {columns(n, given.has_energy)}'"]
    lines += ["   do i = 1, size(averages%t)", "      print '(*(es25.17e3, 1x))', averages%t(i), &"]
    lines += ["         (averages%mean(k, i), averages%se_mean(k, i), k=1, size(averages%mean, 1))", "   end do"]
    return [*(line for x in lines for line in wrapped(x, WIDTH, " " * 16, " &")), f"end program run_of_{given.stem}"]


def _model(given: Given) -> list[str]:
    if given.model is None:
        keys = ", ".join(f"'{x}'" for x in given.parameters)
        values = ", ".join(_number(v) for v in given.parameters.values())
        return [
            f"   call get_model(model, '{given.name}', [character(len=32) :: {keys}], [real(wp) :: {values}], error)"
        ]
    traits = given.model.traits
    offered = ("has_value", "has_hessian", *(["has_hessian_vector"] if given.is_chain else []))
    lines = [f"   model%name = '{given.name}'", "   ! what may be left out; false ones are refused"]
    lines += [f"   model%traits%ndof = {traits.ndof}", f"   model%traits%nnoise = {traits.nnoise}"]
    lines += [f"   model%traits%{x} = .true." for x in (*(f for f in FLAGS if getattr(traits, f)), *offered)]
    if given.third:
        lines += ["   model%traits%has_third_derivative = .true."]
    if traits.bandwidth is not None:
        lines += [f"   model%traits%bandwidth = {traits.bandwidth}"]
    if found := supports(given):
        lines += [f"   model%traits%touches%from = [{', '.join(map(str, found[0]))}]"]
        lines += [f"   model%traits%touches%dof = [{', '.join(map(str, found[1]))}]"]
    if traits.split:
        lines += [f"   allocate (model%traits%quadratic_part({2 * traits.ndof}, {2 * traits.ndof}), source=0.0_wp)"]
        there = entries(traits.split)
        lines += [f"   model%traits%quadratic_part({i + 1}, {j + 1}) = {_number(x)}" for i, j, x in there]
        lines += ["   model%traits%kicks_of_actions = .true."] if traits.turned else []
        lines += ["   model%traits%phase_noise = .true."] if traits.kicks == "phases" else []
    return [*lines, f"   model%traits%rotation = {_array(traits.rotation)}"] if traits.rotation else lines


def _option(name: str, value: float) -> str:
    if name == "common_noise":
        return "[" + ", ".join(str(k) for k in range(1, 65) if value >> (k - 1) & 1) + "]"
    if name in _LOGICAL:
        return ".true." if value else ".false."
    if name in _LONG:
        signed = value - 2**64 if value >= 2**63 else value  # the same 64 bits as a signed number
        return f"{signed}_i8" if signed > -(2**63) else "-huge(1_i8) - 1_i8"
    return str(value) if isinstance(value, int) else _number(value)


def _number(value: float | str) -> str:
    return f"{float(value)!r}_wp"


def _array(values) -> str:
    return "[" + ", ".join(_number(float(x)) for x in values) + "]"


def _state(values: tuple[float, ...]) -> str:
    """Write an initial state; many equal numbers as a scalar."""
    return f"spread({_number(values[0])}, 1, {len(values)})" if equal(values) else _array(values)
