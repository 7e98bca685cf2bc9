# SPDX-License-Identifier: BSD-3-Clause
"""Draw every committed figure again from its data, the JSON file beside it.

    .venv/bin/python docs/figures.py                     # draw all
    .venv/bin/python docs/figures.py --measure           # first the data of those without run times
    .venv/bin/python docs/figures.py --horizons          # those of horizons, which are run times: on a quiet machine

Without run times are kubo_invariant, mean-square, weak-orders, step-limits, contraction and the drawings.
The other data are written with their pages, which hold run times: `symsde stability --markdown docs/stability.md` and
`symsde study --all examples/scenes --markdown docs/work-precision.md`. A test draws all figures and compares them.
"""

import functools
import json
import sys
from pathlib import Path

from symsde.native import files
from symsde.studies import study
from symsde.studies.paper import symplecticity
from symsde.studies.stability import bifurcation, limits, long_time, stability_figure
from symsde.studies.study import study_page

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "bench"))
sys.path.insert(0, str(Path(__file__).resolve().parent))
import contraction
import drawings
import first_screen
import horizons
import mean_square_map
import symsde as ss
import weak_orders
import which_scheme
from peers import page as peers


def first_paths(picture: Path, given: dict) -> None:
    """The figure of first-ten-minutes.md: its data are the arguments that the page gives."""
    ss.simulate(ss.model_from_sympy(**given["model"]), **given["run"]).plot(picture, **given["plot"])


FOLDER = Path(__file__).with_name("figures")
OTHERS = {
    "first-paths": first_paths,
    "stability": stability_figure.save,
    "work-precision": study_page.save_first,
    "fixed-points": bifurcation.save,
    "step-limits": limits.save,
    "long-time": long_time.save,
    "mean-square": mean_square_map.save,
    "horizons": horizons.save,
    "performance": first_screen.save,
    "peers": peers.save,
    "weak-orders": weak_orders.save,
    "which-scheme": drawings.save_questions,
    "step": drawings.save_step,
    "contraction": contraction.save,
} | dict.fromkeys(drawings.BANDS, drawings.save_bands)  #: stem of the data -> drawing
DRAWN = {"which-scheme": which_scheme.picture, "step": drawings.step, "step-limits": limits.growth}
DRAWN |= {"contraction": contraction.compute}
DRAWN |= {page: functools.partial(drawings.bands, page) for page in drawings.BANDS}


def draw(data: Path, picture: Path) -> None:
    """Draw the figure of a data file."""
    found = json.loads(data.read_text(encoding="utf-8"))
    if data.stem == "kubo_invariant":
        symplecticity.draw_invariant(found, picture)
    elif data.stem in OTHERS:
        OTHERS[data.stem](picture, found)
    else:
        study.of_data(found).plot(picture)


def measure() -> None:
    """Compute the data of drawings, of the README's figure and of weak orders (seconds), and of mean-square stability
    (a minute)."""
    for name, compute in DRAWN.items():
        (FOLDER / f"{name}.json").write_text(files.json_text(compute()), encoding="utf-8")
    text = files.json_text(symplecticity.invariant_curves())
    (FOLDER / "kubo_invariant.json").write_text(text, encoding="utf-8")
    for name, module in (("mean-square", mean_square_map), ("weak-orders", weak_orders)):
        (FOLDER / f"{name}.json").write_text(files.json_text(module.compute()), encoding="utf-8")


def main() -> None:
    """Draw everything that has data."""
    if "--measure" in sys.argv[1:]:
        measure()
    if "--horizons" in sys.argv[1:]:
        (FOLDER / "horizons.json").write_text(files.json_text(horizons.compute()), encoding="utf-8")
    for data in sorted(FOLDER.glob("*.json")):
        draw(data, data.with_suffix(".png"))


if __name__ == "__main__":
    main()
