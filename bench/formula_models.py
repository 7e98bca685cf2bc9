# SPDX-License-Identifier: BSD-3-Clause
"""Models of the catalogue as a user writes them: by their formulas, with the same parameters."""

import symsde as ss

SPRINGS = "Sum(p[i]**2/2, i) + Sum((q[i+1]-q[i])**2/2 + beta*(q[i+1]-q[i])**4/4, i)"
# model of the catalogue -> H, noises, what is given beside
TEXTS = {
    "kubo": ("a*(p**2 + q**2)/2", ["sigma*(p**2 + q**2)/2"], {}),
    "linear_oscillator": ("(p**2 + q**2)/2", ["-sigma*q"], {}),
    "additive_oscillator": ("(p**2 + q**2)/2", ["sigma*p", "-gamma*q"], {}),
    "noncommutative_oscillator": ("(p**2 + q**2)/2", ["s1*p**2/2", "s2*q**2/2"], {}),
    "synchrotron": ("p**2/2 - omega**2*cos(q)", ["sigma1*sin(q)", "-sigma2*cos(q)"], {}),
    "pendulum": ("p**2/2 - cos(q)", ["sigma*(p**2 + q**2)/2"], {}),
    "henon_heiles": (
        "(p1**2 + p2**2 + q1**2 + q2**2)/2 + alpha*(q1**2*q2 - q2**3/3)",
        ["sigma1*q1", "sigma2*q2"],
        {},
    ),
    "fpu_chain": (SPRINGS, ["-sigma*q[k]"], {"ends": "fixed"}),
}

ROTATORS = "Sum(p[i]**2/2, i) + Sum(q[i]**2/2, i) - (Sum(cos(q[i]), i)**2 + Sum(sin(q[i]), i)**2)/(2*N)"


def mean_field(n: int) -> ss.Model:
    """The mean field of loop_models by functions of sums over sites, whose noise pulls at all sites alike."""
    return ss.model_from_sympy(ROTATORS, ["-0.03*Sum(q[i], i)"], params={"N": n}, n=n)


def by_formula(model: ss.Model) -> ss.Model:
    """A built-in model once more."""
    H, noise, more = TEXTS[model.name]
    params = dict(model.parameters)
    if "n" in params:
        more = {**more, "n": int(params.pop("n"))}
    return ss.model_from_sympy(H, noise, params=params, **more)
