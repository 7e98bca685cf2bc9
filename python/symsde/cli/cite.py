# SPDX-License-Identifier: BSD-3-Clause
"""`symsde cite`: BibTeX of this project, of the paper it implements, and of the sources of schemes."""

from __future__ import annotations

import argparse
from collections.abc import Iterable

from .. import schemes
from ..native.build import build_info

HELP = "Print BibTeX of this project, of the paper that it follows, and of where a scheme comes from."
#: The references, in the wording of the library. Fields that could not be confirmed are left out.
_SOURCES = {
    "[WHSB]": """@article{WHSB,
  author = {Wang, Lijin and Hong, Jialin and Scherer, Rudolf and Bai, Fengshan},
  title = {Dynamics and variational integrators of stochastic {H}amiltonian systems},
  journal = {International Journal of Numerical Analysis and Modeling},
  volume = {6}, number = {4}, pages = {586--602}, year = {2009},
}""",
    "Milstein, Repin, Tretyakov 2002": """@article{MilsteinRepinTretyakovAdditive,
  author = {Milstein, G. N. and Repin and Tretyakov, M. V.},
  journal = {SIAM Journal on Numerical Analysis},
  volume = {39}, pages = {2066--2088}, year = {2002},
  note = {on additive noise; the title could not be confirmed and is left out},
}
@article{MilsteinRepinTretyakovMultiplicative,
  author = {Milstein, G. N. and Repin and Tretyakov, M. V.},
  title = {Numerical methods for stochastic systems preserving symplectic structure},
  journal = {SIAM Journal on Numerical Analysis},
  volume = {40}, pages = {1583--1604}, year = {2003},
}""",
    "Holm, Tyranowski 2018": """@article{HolmTyranowski2018,
  author = {Holm, Darryl D. and Tyranowski, Tomasz M.},
  title = {Stochastic discrete {H}amiltonian variational integrators},
  journal = {BIT Numerical Mathematics},
  volume = {58}, number = {4}, pages = {1009--1048}, year = {2018},
  doi = {10.1007/s10543-018-0720-2},
}""",
    "Ma, Ding, Ding 2012": """@article{MaDingDing2012,
  author = {Ma, Qiang and Ding and Ding, Xiaohua},
  title = {Symplectic conditions and stochastic generating functions of stochastic {R}unge-{K}utta methods
           for stochastic {H}amiltonian systems with multiplicative noise},
  journal = {Applied Mathematics and Computation},
  volume = {219}, year = {2012},
}""",
    "Ma, Ding 2015": """@article{MaDing2015,
  author = {Ma, Qiang and Ding, Xiaohua},
  journal = {Applied Mathematics and Computation},
  volume = {252}, year = {2015},
  note = {the title could not be confirmed and is left out},
}""",
    "Castell 1993": """@article{Castell1993,
  author = {Castell, F.},
  title = {Asymptotic expansion of stochastic flows},
  journal = {Probability Theory and Related Fields},
  volume = {96}, year = {1993},
}""",
    "Chen, Cohen, D'Ambrosio, Lang 2020": """@article{ChenCohenDAmbrosioLang2020,
  author = {Chen and Cohen and D'Ambrosio and Lang},
  title = {Drift-preserving numerical integrators for stochastic {H}amiltonian systems},
  year = {2020},
}""",
    "Cohen 2012": """@article{Cohen2012,
  author = {Cohen, D.},
  title = {On the numerical discretisation of stochastic oscillators},
  journal = {Mathematics and Computers in Simulation},
  volume = {82}, number = {8}, pages = {1478--1495}, year = {2012},
}""",
    "Chin 1997": """@article{Chin1997,
  author = {Chin, Siu A.},
  title = {Symplectic integrators from composite operator factorizations},
  journal = {Physics Letters A},
  volume = {226}, pages = {344--348}, year = {1997},
  doi = {10.1016/S0375-9601(97)00003-0},
  note = {forward algorithm 4A},
}""",
    "Kloeden, Platen 1992": """@book{KloedenPlaten1992,
  author = {Kloeden, P. and Platen, E.},
  title = {Numerical Solution of Stochastic Differential Equations},
  publisher = {Springer}, year = {1992},
}""",
}


def cite(scheme: str | None = None) -> str:
    """BibTeX of this project and of the paper; with a scheme, also of the sources that the library names for it."""
    entries = [_project(), _SOURCES["[WHSB]"]]
    if scheme is not None:
        entries += [_SOURCES[key] for key in sources(schemes.get(scheme).info.reference) if key != "[WHSB]"]
    return "\n".join(entries)


def sources(reference: str) -> Iterable[str]:
    """The keys of the works that a reference of the library names, such as '[WHSB] (71)-(72); Milstein, Repin,
    Tretyakov 2002'."""
    return [key for key in _SOURCES if key in reference]


def _project() -> str:
    version = build_info().get("version", "?")
    return f"""@software{{symsde,
  author = {{{{symsde developers}}}},
  title = {{symsde: symplectic integrators for stochastic {{H}}amiltonian systems}},
  version = {{{version}}},
}}"""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `symsde cite`."""
    parser.add_argument("--scheme", metavar="NAME", help="also print the sources of this scheme")


def run(options: argparse.Namespace) -> int:
    """Print the entries, below the library's reference of the scheme as a comment."""
    if options.scheme is not None:
        print(f"% {options.scheme}: {schemes.get(options.scheme).info.reference}")
    print(cite(options.scheme))
    return 0
