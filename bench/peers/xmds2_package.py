# SPDX-License-Identifier: BSD-3-Clause
"""XMDS2: a program in C++ from a description in XML, by its algorithm RK4, which solves the Stratonovich equation.

It draws its own paths and prints means over them. Seconds are the program's time with many paths minus its time with
few; the error is measured with the same rule on the common increments (numpy_steps.py).
"""

from __future__ import annotations

import os
import resource
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from .equations import NOISE, OMEGA, SIGMA, SIGMA1, SIGMA2, SMALL, Problem
from .numpy_steps import integrated, rk4_step
from .prepared import Prepared

if shutil.which("xmds2") is None:
    raise ImportError("there is no program xmds2: apt-get install xmds2")
VERSION = subprocess.run(["xmds2", "--version"], capture_output=True, text=True, check=False).stdout.strip()
VERSION = next((line.strip() for line in VERSION.splitlines() if "version" in line.lower()), "XMDS2")

_XML = """<?xml version="1.0" encoding="UTF-8"?>
<simulation xmds-version="2">
  <name>peer</name>
  <driver name="multi-path" paths="{paths}" />
  <geometry><propagation_dimension>t</propagation_dimension></geometry>
  <vector name="main" type="real"><components>{components}</components>
    <initialisation><![CDATA[{start}]]></initialisation></vector>
  <noise_vector name="noise" type="real" kind="wiener" method="posix" seed="1"><components>{noises}</components></noise_vector>
  <sequence><integrate algorithm="RK4" interval="{horizon}" steps="{steps}"><samples>1</samples>
    <operators><integration_vectors>main</integration_vectors><dependencies>noise</dependencies>
      <![CDATA[{equations}]]></operators></integrate></sequence>
  <output><sampling_group><moments>meanq</moments><dependencies>main</dependencies>
    <![CDATA[meanq = q1;]]></sampling_group></output>
</simulation>
"""  # noqa: E501


def _equations(name: str, dof: int) -> list[str]:
    """Equations of motion in XMDS2's language."""
    if name == "kubo":
        return [f"dp1_dt = -(1 + {SIGMA}*w1)*q1;"]
    if name == "synchrotron":
        return [f"dp1_dt = -({OMEGA**2} + {SIGMA2}*w2)*sin(q1) - {SIGMA1}*w1*cos(q1);"]
    if name == "additive":
        return ["dp1_dt = -q1 + w1;"]
    if name == "henon_heiles":
        return [f"dp1_dt = -q1 - 2*q1*q2 - {SMALL}*w1;", f"dp2_dt = -q2 - q1*q1 + q2*q2 - {SMALL}*w2;"]
    lines = []
    for i in range(1, dof + 1):
        right = f"(q{i + 1} - q{i})" if i < dof else f"(-q{i})"
        left = f"(q{i} - q{i - 1})" if i > 1 else f"q{i}"
        lines.append(f"dp{i}_dt = {right}*(1 + {right}*{right}) - {left}*(1 + {left}*{left}) + {NOISE}*w{i};")
    return lines


def rk4(problem: Problem, steps: int, dw: np.ndarray) -> Prepared:
    """The time of XMDS2's RK4, and the error of the same rule in NumPy."""
    sites = range(1, problem.dof + 1)
    moved = f"(1 + {SIGMA}*w1)*" if problem.name == "kubo" else ""
    text = {
        "components": " ".join([f"q{i}" for i in sites] + [f"p{i}" for i in sites]),
        "start": " ".join(
            f"q{i} = {q!r}; p{i} = {p!r};" for i, q, p in zip(sites, problem.q0, problem.p0, strict=True)
        ),
        "noises": " ".join(f"w{k}" for k in range(1, problem.noises + 1)),
        "horizon": problem.horizon,
        "steps": steps,
        "equations": "\n".join([f"dq{i}_dt = {moved}p{i};" for i in sites] + _equations(problem.name, problem.dof)),
    }
    many = max(256, 2**22 // (steps * problem.dof))
    with tempfile.TemporaryDirectory() as folder:
        spent = {}
        for paths in (8, many):
            place = Path(folder, str(paths))
            place.mkdir()
            (place / "peer.xmds").write_text(_XML.format(paths=paths, **text))
            made = subprocess.run(["xmds2", "peer.xmds"], cwd=place, capture_output=True, text=True, check=False)
            if made.returncode:
                raise RuntimeError(made.stdout + made.stderr)
            spent[paths] = min(_child(["./peer"], place) for _ in range(3))
    seconds = (spent[many] - spent[8]) / (many - 8)
    return Prepared(lambda: integrated(problem, steps, dw, rk4_step), dw.shape[2], seconds=seconds)


def _child(command: list[str], place: Path) -> float:
    """Processor seconds of a command."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, cwd=place, capture_output=True, check=True, env={**os.environ, "OMP_NUM_THREADS": "1"})
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


SCHEMES = {"RK4": rk4}
