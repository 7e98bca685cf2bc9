# SPDX-License-Identifier: BSD-3-Clause
"""The Python reference: every public name of the package, in these groups, described by its docstring."""

import symsde

INTRODUCTION = """\
# Python interface

`import symsde as ss`. All quantities are dimensionless. The path is the last axis of every array. The user guide is
[symsde in Python](../python.md).
"""
GROUPS = {
    "Models": ("Model", "Traits", "FormulaModel", "model_from_sympy", "numba_signature", "numba_sincos"),
    "Runs": ("simulate", "Run", "moments", "Moments", "prepare", "PreparedRun", "Report", "step", "increments"),
    "Ensembles in shards": ("ensemble", "open_run", "OpenRun"),
    "Schemes": ("Scheme", "advise", "Advice"),
    "Errors of an answer": ("expect", "Answer", "Alternative", "mlmc", "Multilevel", "level_sampler", "LevelSampler"),
    "Errors of a scheme": ("convergence", "Convergence", "work_precision", "WorkPrecision"),
    "Brackets and growth": ("commutator", "Commutator", "mean_square", "MeanSquare"),
    "The library itself": ("build_info", "selftest", "status_text"),
    "Exceptions and warnings": (
        "SymsdeError",
        "PathsFailedWarning",
        "BudgetWarning",
        "ReferenceWarning",
        "NotANumberWarning",
    ),
}
#: Members that the package uses itself; users have no need of them.
INTERNAL = {
    "Model": ("builtin", "call", "check_start", "in_python"),
    "Traits": ("kicked",),
    "FormulaModel": ("call", "check_start"),
    "Run": ("attributes", "fill", "path"),
    "Moments": ("attributes", "doubts", "fill", "fill_from_sums", "kept", "remarks", "scope"),
    "OpenRun": ("manifest", "scene"),
    "LevelSampler": ("draw", "draw_from"),
    "WorkPrecision": ("about", "data", "resumed"),
}
INTERNAL_OF_MODULES = {
    "diagnose": ("driving_increments", "exact_of"),
    "errors": ("from_code", "shortened"),
    "observe": ("fields", "kept", "names", "remarks", "struct", "variables"),
    "schemes": ("as_scheme",),
}
MODULES = ("models", "schemes", "observe", "diagnose", "errors")
SKIPPED = ("__version__", *MODULES)


def page():
    """The page; ValueError where a group holds what is not public. What is in no group comes last."""
    grouped = [name for names in GROUPS.values() for name in names]
    wanted = [name for name in symsde.__all__ if name not in SKIPPED]
    if gone := sorted(set(grouped) - set(wanted)):
        raise ValueError(f"these names of GROUPS are not public: {', '.join(gone)}")
    others = {"Further": tuple(name for name in wanted if name not in grouped)}
    found = [INTRODUCTION]
    for title, names in (GROUPS | (others if others["Further"] else {})).items():
        found += [f"## {title}\n", *map(_entry, names)]
    for name in MODULES:
        without = f"\n   :exclude-members: {', '.join(INTERNAL_OF_MODULES.get(name, ()))}" * (
            name in INTERNAL_OF_MODULES
        )
        block = f".. automodule:: symsde.{name}\n   :members:\n   :no-index:{without}"
        found += [f"## `symsde.{name}`\n", _block(block)]
    return "\n".join(found)


def _entry(name):
    thing = getattr(symsde, name)
    kind = "function" if callable(thing) else "data"
    if isinstance(thing, type):
        kind = "exception" if issubclass(thing, BaseException) else "class"
    more = "\n   :members:" if kind == "class" else ""
    more += "\n   :inherited-members:" if name == "Model" else ""
    if name in INTERNAL:
        more += f"\n   :exclude-members: {', '.join(INTERNAL[name])}"
    return _block(f".. auto{kind}:: symsde.{name}{more}\n")


def _block(text):
    return f"```{{eval-rst}}\n{text.rstrip()}\n```\n"
