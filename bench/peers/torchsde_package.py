# SPDX-License-Identifier: BSD-3-Clause
"""torchsde (X. Li): batches of paths in PyTorch, in double precision on one thread."""

from __future__ import annotations

from importlib.metadata import version

import numpy as np
import torch
import torchsde

from .equations import Problem
from .prepared import Prepared

torch.set_num_threads(1)
VERSION = f"torchsde {version('torchsde')}, torch {torch.__version__}"


class _Given(torchsde.BaseBrownian):
    """The increments that all packages get."""

    def __init__(self, dw: np.ndarray, h: float):
        super().__init__()
        _, noises, paths = dw.shape
        self._w = torch.from_numpy(np.ascontiguousarray(dw.transpose(0, 2, 1)))
        self._h, self._shape = h, (paths, noises)

    def __call__(self, ta, tb=None, return_U=False, return_A=False):
        return self._w[round(float(ta) / self._h)]

    def __repr__(self):
        return "given increments"

    dtype = property(lambda self: torch.float64)
    device = property(lambda self: torch.device("cpu"))
    shape = property(lambda self: self._shape)
    levy_area_approximation = property(lambda self: "none")


class _Equations(torch.nn.Module):
    """Drift and noise as torchsde calls them, paths first."""

    noise_type, sde_type = "general", "stratonovich"

    def __init__(self, problem: Problem):
        super().__init__()
        self.problem = problem

    def _slope(self, z, h, w):
        dof = self.problem.dof
        return torch.cat(self.problem.slope(torch, z.T[:dof], z.T[dof:], h, w.T)).T

    def f(self, t, z):
        return self._slope(z, 1.0, torch.zeros(len(z), self.problem.noises, dtype=z.dtype))

    def g_prod(self, t, z, v):
        return self._slope(z, 0.0, v)

    def f_and_g_prod(self, t, z, v):
        return self.f(t, z), self.g_prod(t, z, v)


def heun(problem: Problem, steps: int, dw: np.ndarray) -> Prepared:
    """torchsde's method "heun"."""
    h, paths = problem.horizon / steps, dw.shape[2]
    start = torch.tensor([*problem.q0, *problem.p0], dtype=torch.float64).repeat(paths, 1)
    times = torch.tensor([0.0, problem.horizon], dtype=torch.float64)
    equations, brownian = _Equations(problem), _Given(dw, h)

    def run():
        with torch.no_grad():
            found = torchsde.sdeint(equations, start, times, bm=brownian, method="heun", dt=h)
        return found[-1].numpy().T

    return Prepared(run, paths)


SCHEMES = {"heun": heun}
