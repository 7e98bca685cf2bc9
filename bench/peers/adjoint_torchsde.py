# SPDX-License-Identifier: BSD-3-Clause
"""The gradients of adjoint.py by torchsde, in an interpreter that has it: adjoint_torchsde.py FILE.

The answer is written to FILE: version, and ns of a path-step for each way. All paths at once, in double precision on
one thread. The adjoints solve an equation backward in time; heun is differentiated through all its operations.
"""

import json
import sys
import time
from importlib.metadata import version
from pathlib import Path

STEPS, PATHS, STEP, START, VALUES = 1000, 1000, 0.01, (0.7, 0.3), (1.3, 0.4)


def main(file: str, steps: int = STEPS) -> None:
    """Measure every way."""
    import torch  # noqa: PLC0415
    import torchsde  # noqa: PLC0415

    torch.set_num_threads(1)

    class Pendulum(torch.nn.Module):
        """The noisy pendulum."""

        noise_type, sde_type = "general", "stratonovich"

        def __init__(self):
            super().__init__()
            self.k, self.sigma = (torch.nn.Parameter(torch.tensor(x, dtype=torch.float64)) for x in VALUES)

        def f(self, t, z):
            return torch.stack((z[:, 1], -self.k * torch.sin(z[:, 0])), 1)

        def g(self, t, z):
            return torch.stack((torch.zeros_like(z[:, 0]), -self.sigma * torch.cos(z[:, 0])), 1).unsqueeze(2)

    start = torch.tensor(START, dtype=torch.float64).repeat(PATHS, 1)
    times = torch.tensor([0.0, STEP * steps], dtype=torch.float64)
    reversible = {"method": "reversible_heun", "adjoint_method": "adjoint_reversible_heun"}
    ways = {
        "adjoint, reversible_heun": (torchsde.sdeint_adjoint, reversible),
        "adjoint, midpoint": (torchsde.sdeint_adjoint, {"method": "midpoint", "adjoint_method": "midpoint"}),
        "through heun": (torchsde.sdeint, {"method": "heun"}),
    }
    found = {}
    for name, (solve, how) in ways.items():
        model = Pendulum()
        begin = time.process_time()
        (solve(model, start, times, dt=STEP, **how)[-1][:, 0] ** 2).mean().backward()
        found[name] = 1e9 * (time.process_time() - begin) / (steps * PATHS)
        if not (torch.isfinite(model.k.grad) and torch.isfinite(model.sigma.grad)):
            raise ValueError(f"{name} gave no derivatives")
    told = {"version": f"torchsde {version('torchsde')}, torch {torch.__version__}", "ns": found}
    Path(file).write_text(json.dumps(told))


if __name__ == "__main__":
    main(sys.argv[1], *map(int, sys.argv[2:]))
