# SPDX-License-Identifier: BSD-3-Clause
"""Output and files of the command line: tables, manifests, programs, merged shards."""

import json
import re
import warnings
from pathlib import Path

import numpy as np
import symsde as ss
from recorded import code, facts
from recorded_calls import set_apart
from symsde.cli import command_line

SCENE = """
[run]
step = {step}
steps = 8
paths = 600
seed = 3
t0 = 0.2
save_every = {every}
scheme = "{scheme}"
q0 = {q0}
p0 = {p0}
{more}
[output]
moments = true
paths = [0, 3, 300]
[study]
steps = [4, 8]
[expect]
f = "q1**2"
horizon = 0.5
abs = 0.05
[observables]
square = "q1**2 + 0.3*p1**2"
[[observe]]
name = "h"
kind = "histogram"
of = "q_1"
low = -1.0
high = 1.0
bins = 5
[[observe]]
name = "loss"
kind = "passage"
of = "p_1"
within = 0.9
absorb = {absorb}
[model]
{model}
"""
SCENES = {
    "kubo": ("stormer_verlet", 0.4, 0.1, 'name = "kubo"\nsigma = 0.4'),
    "driven": ("gauss_dkdkd", 0.4, 0.1, 'name = "driven_pendulum"\nsigma1 = 0.4'),
    "heiles": ("verlet_kdk", [0.9, 0.2], [0.1, -0.3], 'name = "henon_heiles"\nsigma1 = 0.4'),
    "chain": ("chin4a", 0.1, [0.3, 0.0, 0.1, 0.2], 'name = "fpu_chain"\nn = 4'),
    "formula": ("euler_maruyama", 0.3, 0.2,
                'H = "p**2/2 + k*sin(q - 0.2*t)"\nnoise = ["0.3*q", "0.2*cos(q)*t"]\nparams = {k = 1.5}'),
    "sites": ("heun", 0.3, [0.2, 0.1, 0.0],
              'n = 3\nH = "Sum(p[i]**2/2 + cos(q[i+1]-q[i]), i)"\nnoise = ["0.3*q[1]", "0.1*q[3]**2"]'),
}  # fmt: skip
PLAIN = (
    "list", "list --markdown", "list schemes", "cite --scheme midpoint", "cite --scheme gauss2_strong32", "template x",
    "template kubo", "template formula", "template fpu_chain", "export s.toml --to c", "merge a b --out c", "plot a",
    "study s.toml --steps 3,5", "run s.toml --shard 3/2",
)  # fmt: skip
PLACES = re.compile(r"(?<=-o s) .*|0\.1\.0[\w.]*")  # paths of headers and library, and the version
OF_MACHINE = re.compile(r"# (history|date|report|command|symsde_|source|python|host|numpy|system|platform|commit)")
MACHINES = {"build", "compiler", "hash", "version", "H", "noises", "scheme", "rotation"}  # in manifests; hashes of bits


def without(found):
    """A manifest without entries that depend on the machine or on rounding."""
    if isinstance(found, dict):
        return {key: without(x) for key, x in found.items() if key not in MACHINES}
    return found


def held(folder):
    """Contents of files: tables as numbers, other text without machine and time."""
    found = []
    for path in sorted(x for x in Path(folder).rglob("*") if x.suffix in {".csv", ".f90", ".c", ".toml", ".json"}):
        text = path.read_text(encoding="utf-8")
        if path.suffix == ".json":
            text = json.dumps(without(json.loads(text)), sort_keys=True)
        lines = [x for x in PLACES.sub("~", text).splitlines() if not OF_MACHINE.match(x)]
        rows = [x for x in lines if re.match(r"-?\d", x) and path.suffix == ".csv"]
        cells = [x for row in rows for x in re.split(r"[,\s]+", row) if re.fullmatch(r"[-+.\deE]+|NaN", x)]
        found += [np.array([float(x) for x in cells]), path.name, len(rows)]
        found.append("\n".join(x for x in lines if x not in rows))
    return found


def command(text, **scenes):
    """Printed text and files of commands."""
    with set_apart() as printed, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name, written in scenes.items():
            Path(f"{name}.toml").write_text(written, encoding="utf-8")
        codes = []
        for line in text.split("; "):
            try:
                codes.append(command_line.main(line.split()))
            except SystemExit as end:
                codes.append(str(end.code))
        loaded = [ss.open_run(x) for x in sorted(Path().iterdir()) if (x / "manifest.json").exists()]
        arrays = []
        for m, run in ((x.moments, x.run) for x in loaded if not x.missing):
            arrays += [m._tables, m.m2, m.n_ok, [vars(x) for x in m.observed.values()], run.q, run.p, run.status]
        told = [
            re.sub(r"\S+ (s|seconds)\b", "~", PLACES.sub("~", printed.getvalue())),
            codes,
            [repr(x) for x in loaded],
        ]
        return [*facts(held("."), arrays, rtol=1e-8), code(*told)]


def commands():
    """The commands of the command line, each in a folder of its own."""
    for i, (name, (scheme, q0, p0, model)) in enumerate(SCENES.items()):
        given = {"scheme": scheme, "q0": q0, "p0": p0, "model": model, "every": 2 + 2 * (i % 2)}
        given |= {"more": ("compensated = true", "refine = 1")[i % 2], "absorb": ("true", "false")[i // 2 % 2]}
        text, forward = (SCENE.format(step=h, **given) for h in ((-0.1, 0.07)[i % 2], 0.1))
        yield f"run {name}", command("run s.toml --out a --shard-paths 256; check s.toml", s=text)
        parts = [f"run s.toml --out {x} --shard {x}/2 --shard-paths 256" for x in (1, 2)]
        yield f"merge {name}", command("; ".join([*parts, "merge 1 2 --out c"]), s=text)
        yield f"export {name}", command("export s.toml --to fortran; export s.toml --to c", s=forward)
        yield f"expect {name}", command("expect s.toml --quiet", s=forward)
        yield f"check {name}", command("run s.toml --out a --error-check --quiet", s=text)
    for text in PLAIN:
        yield text, command(text)


GROUPS = (commands,)
