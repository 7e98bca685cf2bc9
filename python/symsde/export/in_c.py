# SPDX-License-Identifier: BSD-3-Clause
"""The program in C: the code of the formula emitters, which Python compiles too, and a main program."""

from __future__ import annotations

from ..model.formulas import emit_flow
from ..model.split import KICKS
from ..model.traits import FLAGS
from .expressions import wrapped
from .given import Given, columns, entries, equal, harmless, supports

WIDTH = 110
ARGUMENTS = ("gradient", "value", "hessian", "hessian_vector")  #: function arguments of symsde_model_new, in this order
SETTERS = ("gradient_hessian", "third_derivative", "chain_rows")  #: functions that have their own setter
#: products that are fused into sums are declared as variables too, and are then unused
MODEL = ("#pragma GCC diagnostic push", '#pragma GCC diagnostic ignored "-Wunused-variable"')


def source(given: Given, compile_line: str) -> str:
    """The text of the whole file."""
    head = ["/*", *(f" * {line}".rstrip() for line in given.title), " *", f" *    {compile_line}", " */"]
    head += ["#include <math.h>", "#include <stdio.h>", "#include <stdlib.h>", "#include <symsde.h>", ""]
    model = [] if given.model is None else [*MODEL, given.model.formula.source, "#pragma GCC diagnostic pop", ""]
    return "\n".join([*head, *model, *_main(given)]) + "\n"


def _main(given: Given) -> list[str]:
    n = len(given.q0)
    nvalue = 2 * n + int(given.has_energy)
    lines = [
        "static void check(int status, const symsde_error *error) {",
        "   if (status == SYMSDE_OK)",
        "      return;",
    ]
    lines += ['   fprintf(stderr, "status %d: %s\\n", status, error->message);']
    lines += ["   if (status != SYMSDE_PATHS_FAILED)", "      exit(1);", "}", ""]
    lines += [f"enum {{ NDOF = {n}, NTIME = {given.ntime}, NVALUE = {nvalue} }};", ""]
    lines += [
        "int main(void) {",
        "   symsde_error error;",
        "   symsde_model model = NULL;",
        "   symsde_scheme scheme = NULL;",
    ]
    lines += _model(given)
    lines += [f'   check(symsde_scheme_get("{given.scheme}", &scheme, &error), &error);', ""]
    lines += ["   symsde_options options;", "   symsde_options_init(&options);"]
    lines += [f"   options.{name} = {_literal(name, value)};" for name, value in given.options.items()]
    lines += ["", *_state("q0", given.q0), *_state("p0", given.p0)]
    lines += ["   symsde_input input;", "   symsde_input_init(&input);"]
    lines += ["   input.q0 = q0; /* one state for all paths */", "   input.p0 = p0;", ""]
    lines += ["   static double t[NTIME], mean[NTIME][NVALUE], variance[NTIME][NVALUE], se[NTIME][NVALUE];"]
    lines += [
        "   static int64_t n_ok[NTIME];",
        "   static symsde_moments moments;",
        "   symsde_moments_init(&moments);",
    ]
    lines += ["   moments.t = t;", "   moments.n_ok = n_ok;", "   moments.mean = &mean[0][0];"]
    lines += ["   moments.variance = &variance[0][0];", "   moments.se_mean = &se[0][0];"]
    lines += ["   check(symsde_compute_moments(model, scheme, &options, &input, &moments, NULL, &error), &error);", ""]
    lines += [f'   puts("# t, then the mean and its standard error of {columns(n, given.has_energy)}");']
    lines += ["   for (int i = 0; i < NTIME; i++) {", '      printf("%.17g", t[i]);']
    lines += ["      for (int k = 0; k < NVALUE; k++)", '         printf(" %.17g %.17g", mean[i][k], se[i][k]);']
    lines += ['      printf("\\n");', "   }", "   symsde_model_delete(&model);", "   symsde_scheme_delete(&scheme);"]
    return [*(line for x in lines for line in wrapped(x, WIDTH, " " * 9)), "   return 0;", "}"]


def _model(given: Given) -> list[str]:
    if given.model is None:
        keys = ", ".join(f'"{x}"' for x in given.parameters) or "NULL"
        count = len(given.parameters)
        return [
            f"   const char *const keys[] = {{{keys}}};",
            f"   const double values[] = {_array(given.parameters.values()) if given.parameters else '{0}'};",
            f'   check(symsde_model_get("{given.name}", {count}, keys, values, &model, &error), &error);',
        ]
    traits = given.model.traits
    lines = [
        "   symsde_traits traits; /* what may be left out; false ones are refused */",
        "   symsde_traits_init(&traits);",
    ]
    lines += [f"   traits.ndof = {traits.ndof};", f"   traits.nnoise = {traits.nnoise};"]
    lines += [f"   traits.{x} = 1;" for x in FLAGS if getattr(traits, x)]
    lines += [f"   traits.bandwidth = {traits.bandwidth};"] if traits.bandwidth is not None else []
    if traits.rotation:
        lines += [f"   const double rotation[] = {_array(traits.rotation)};", "   traits.rotation = rotation;"]
    if found := supports(given):
        lines += [f"   const int32_t touches_from[] = {{{', '.join(map(str, found[0]))}}};"]
        lines += [f"   const int32_t touches[] = {{{', '.join(map(str, found[1]))}}};"]
        lines += ["   traits.touches_from = touches_from;", "   traits.touches = touches;"]
    lines += ["   double par[] = {"] if given.parameters else ["   double par[] = {0};"]
    lines += [
        f"      {'0, /* of each site:' if isinstance(value, tuple) else f'{_number(value)}, /* c{k}:'} {harmless(x)} */"
        for k, (x, value) in enumerate(given.parameters.items())
    ]
    lines += [f"      {_number(x)}," for value in given.parameters.values() if isinstance(value, tuple) for x in value]
    lines += ["   };"] if given.parameters else []
    functions = ", ".join(f"formula_{kind}" for kind in ARGUMENTS)
    lines += [_checked(f'new("{given.name}", &traits, {functions}, par, &model')]
    if traits.split:
        lines += [f"   static double split[{4 * traits.ndof**2}]; /* second derivatives of the quadratic part of H */"]
        lines += [f"   split[{i * 2 * traits.ndof + j}] = {_number(x)};" for i, j, x in entries(traits.split)]
        lines += [_checked("set_quadratic_part(model, split")]
        lines += [_checked(f"set_action_kicks(model, {KICKS.index(traits.kicks)}")] if traits.turned else []
    there = [kind for kind in SETTERS if f"int formula_{kind}(" in given.model.formula.source]
    lines += [_checked(f"set_{kind}(model, formula_{kind}") for kind in there]
    flows = given.model._code.whole_steps
    lines += [_checked(f'set_flow(model, "{emit_flow.named(scheme)}", formula_flow_{scheme}') for scheme in flows]
    return [*lines, _checked("accept_null(model"), _checked("accept_any_lanes(model")]


def _checked(call: str) -> str:
    """A call about the model with a check of its status."""
    return f"   check(symsde_model_{call}, &error), &error);"


def _literal(name: str, value: float) -> str:
    return f"UINT64_C({value})" if name in ("seed", "common_noise") else _number(value)


def _number(value: float) -> str:
    return repr(value)


def _array(values) -> str:
    return "{" + ", ".join(_number(float(x)) for x in values) + "}"


def _state(name: str, values: tuple[float, ...]) -> list[str]:
    """Set an initial state; many equal numbers by a loop."""
    if not equal(values):
        return [f"   static const double {name}[NDOF] = {_array(values)};"]
    loop = ["   for (int i = 0; i < NDOF; i++)", f"      {name}[i] = {_number(values[0])};"]
    return [f"   static double {name}[NDOF];", *loop]
