# SPDX-License-Identifier: BSD-3-Clause
"""The program in C."""

from __future__ import annotations

from ..model.definition import FLAGS
from ..model.formulas import emit_c
from .expressions import Expressions, called, wrapped
from .given import Given, columns, equal

WIDTH = 110
DIGITS, LETTERS = "0123456789", "wqpab"
IN = "int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p"
BLOCKS = {"value": ("value",), "gradient": ("hq", "hp"), "hessian": ("hqq", "hqp", "hpp")}
THIRD = {"third_derivative": ("tq", "tp")}
#: functions that C has not
FUNCTIONS = {
    "sech": "2 / (exp(x) + exp(-x))",
    "csch": "1 / sinh(x)",
    "coth": "1 / tanh(x)",
    "gauss": "exp(-x * x)",
    "logcosh": "fabs(x) < 1 ? log(cosh(x)) : fabs(x) - log(2) + log1p(exp(-2 * fabs(x)))",
}
ABOUT = {
    "value": "S = sum_j w[j] H_j: arrays are [..][nlane], one lane is one path",
    "gradient": "S_q and S_p",
    "hessian": "S_qq, S_qp and S_pp",
    "third_derivative": "the gradient of a^T (the Hessian) b",
}


def source(given: Given, compile_line: str) -> str:
    """The whole file."""
    head = ["/*", *(f" * {line}".rstrip() for line in given.title), " *", f" *    {compile_line}", " */"]
    head += ["#include <math.h>", "#include <stdio.h>", "#include <stdlib.h>", "#include <symsde.h>", ""]
    model = []
    if given.model is not None:
        model = _chain(given) if given.is_chain else _functions(given)
    return "\n".join([*head, *model, *_main(given)]) + "\n"


# ---- the model --------------------------------------------------------------------------------------------


def _functions(given: Given) -> list[str]:
    lines = ["typedef struct parameters {"]
    lines += [f"   double {x};" for x in given.identifiers.values()] or ["   int none;"]
    lines += ["} parameters;", ""]
    for name in called(given, FUNCTIONS):
        lines += [f"static inline double {name}(double x) {{", f"   return {FUNCTIONS[name]};", "}", ""]
    for kind in BLOCKS | (THIRD if given.third else {}):
        lines += _function(given, kind)
    return lines


def _function(given: Given, kind: str) -> list[str]:
    made, n = given.model._derivatives, given.model.ndof
    names = list(given.identifiers.values())

    def leaf(name: str) -> str:
        return f"par->{names[int(name[1:])]}" if name[0] == "c" else name

    blocks, nodes = (BLOCKS | THIRD)[kind], made.outputs | given.third
    vectors = emit_c.VECTORS.get(blocks, ())
    outputs = [(block, k, x) for block in blocks for k, x in enumerate(nodes[block])]
    text = Expressions(made.graph, [x for *_, x in outputs], leaf, lambda value: value)
    leaves = {made.graph.nodes[x].value for x in emit_c.reachable(made.graph, [x for *_, x in outputs])}
    loads = [(x, f"{x.rstrip(DIGITS)}[{_at(int(x.lstrip(LETTERS)))}]") for x in _ordered(leaves, given.model.nnoise, n)]
    body = [f"const double {name} = {value};" for name, value in (*loads, *text.parts)]
    body += [f"{block}[{_at(k)}] = {value};" for (block, k, _), value in zip(outputs, text.results, strict=True)]
    given_out = ", ".join([*(f"const double *{x}" for x in vectors), *(f"double *{block}" for block in blocks)])
    return [
        f"/* {ABOUT[kind]} */",
        *wrapped(f"static int {kind}({IN}, {given_out}, void *user) {{", WIDTH, " " * (len(kind) + 12)),
        "   const parameters *par = user;",
        "   (void)ndof, (void)nham, (void)t, (void)w, (void)q, (void)p, (void)par;",
        "   for (int i = 0; i < nlane; i++) {",
        *(line for statement in body for line in wrapped(f"      {statement}", WIDTH, " " * 9)),
        "   }",
        "   return 0;",
        "}",
        "",
    ]


def _ordered(leaves: set, nnoise: int, ndof: int) -> list[str]:
    letters = ("q", "p", "aq", "ap", "bq", "bp")
    every = [f"w{j}" for j in range(nnoise + 1)] + [f"{x}{i}" for x in letters for i in range(ndof)]
    return [x for x in every if x in leaves]


def _at(k: int) -> str:
    return "i" if k == 0 else "nlane + i" if k == 1 else f"{k}*nlane + i"


def _chain(given: Given) -> list[str]:
    """Sums over sites: the code that runs in Python, too, whose functions go from site to site."""
    return [given.model.formula.source, ""]


# ---- the program ------------------------------------------------------------------------------------------


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
    traits, is_chain = given.model.traits, given.is_chain
    lines = [
        "   symsde_traits traits; /* what may be left out; false ones are refused */",
        "   symsde_traits_init(&traits);",
    ]
    lines += [f"   traits.ndof = {traits.ndof};", f"   traits.nnoise = {traits.nnoise};"]
    lines += [f"   traits.{x} = 1;" for x in FLAGS if getattr(traits, x)]
    lines += [f"   traits.bandwidth = {traits.bandwidth};"] if traits.bandwidth is not None else []
    if traits.rotation:
        lines += [f"   const double rotation[] = {_array(traits.rotation)};", "   traits.rotation = rotation;"]
    if is_chain:
        lines += [f"   double par[] = {_array(given.parameters.values()) if given.parameters else '{0}'};"]
        names = ("formula_gradient", "formula_value", "formula_hessian", "formula_hessian_vector", "par")
    else:
        values = ", ".join(f".{given.identifiers[x]} = {_number(v)}" for x, v in given.parameters.items()) or "0"
        lines += [f"   parameters par = {{{values}}};"]
        names = ("gradient", "value", "hessian", "NULL", "&par")
    lines += [f'   check(symsde_model_new("{given.name}", &traits, {", ".join(names)}, &model, &error), &error);']
    third = "third_derivative" if given.third else "formula_third_derivative"
    if given.third or (is_chain and third in given.model.formula.source):
        lines += [f"   check(symsde_model_set_third_derivative(model, {third}, &error), &error);"]
    if is_chain and "formula_chain_rows" in given.model.formula.source:
        lines += ["   check(symsde_model_set_chain_rows(model, formula_chain_rows, &error), &error);"]
    if is_chain:
        lines += ["   check(symsde_model_accept_null(model, &error), &error);"]
    return lines


def _literal(name: str, value: float) -> str:
    return f"UINT64_C({value})" if name in ("seed", "common_noise") else _number(value)


def _number(value: float) -> str:
    return repr(value)


def _array(values) -> str:
    return "{" + ", ".join(_number(float(x)) for x in values) + "}"


def _state(name: str, values: tuple[float, ...]) -> list[str]:
    """One state; of many equal numbers by a loop."""
    if not equal(values):
        return [f"   static const double {name}[NDOF] = {_array(values)};"]
    loop = ["   for (int i = 0; i < NDOF; i++)", f"      {name}[i] = {_number(values[0])};"]
    return [f"   static double {name}[NDOF];", *loop]
