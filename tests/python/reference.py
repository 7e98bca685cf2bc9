# SPDX-License-Identifier: BSD-3-Clause
"""One step of every scheme from its equations (docs/method), by NumPy alone: the reference of suites over axes.

Nothing here calls the library. Hamiltonians are sums of functions of one number a.x, whose derivatives of any order
are written down; coefficients come from quadratures by numpy; implicit equations are solved by Newton's method with
differences of the residual. States are x = (q, p), shape (2 dof, lane).
"""

import itertools
from dataclasses import dataclass
from functools import partial

import numpy as np


class Ridges:
    """H_j(t, x) = sum over ridges of s (1 + e sin(nu t + phase)) f(a.x + b), f = sin or a power, j = 0 .. m."""

    def __init__(self, ndof, nnoise, ridges):
        """Ridges are (j, f, s, e, nu, a, b), f = "sin" or an exponent."""
        self.ndof, self.nnoise = ndof, nnoise
        j, f, s, e, nu, a, b = zip(*sorted(ridges, key=lambda ridge: ridge[1] != "sin"), strict=True)
        self.j, self.sines = np.array(j), sum(x == "sin" for x in f)
        power = np.array(f[self.sines :], float)[:, None]
        self.s, self.e, self.nu, self.b = (np.array(x, float)[:, None] for x in (s, e, nu, b))
        self.a, self.phase = np.array(a, float), 1.7 * np.arange(len(a))[:, None]
        self.powers = [self.a[:, :0].sum(axis=1, keepdims=True) + 1]  # a, a a, a a a, one row a ridge
        self.exponents, self.factors = [power], [np.ones_like(self.s)]  # exponents and factors of derivatives of powers
        for order in range(3):
            self.powers.append((self.powers[-1][:, :, None] * self.a[:, None, :]).reshape(len(self.a), -1))
            self.exponents.append(np.maximum(power - order - 1, 0))
            self.factors.append(self.factors[-1].copy())
            self.factors[-1][self.sines :] *= power - order
        self.wide, self.wide_powers = self.a[:, :, None], [x.T[:, :, None] for x in self.powers]
        of = np.arange(nnoise + 1)[:, None] == self.j  # (hamiltonian, ridge)
        self.sums = [(of[:, None, :] * power.T).reshape(-1, len(self.a)) for power in self.powers]
        field = np.eye(2 * ndof)
        self.turn = np.concatenate([field[ndof:], -field[:ndof]])  # x' = turn grad H

    def along(self, order, t, x):
        """Derivatives of this order of every ridge along its own vector a, (ridge, lane)."""
        y = _product(self.wide, x) + self.b
        f, sines = np.empty_like(y), self.sines
        np.sin(y[:sines] + order * np.pi / 2, out=f[:sines])
        np.power(y[sines:], self.exponents[order], out=f[sines:])
        return f * (self.factors[order] * self.s * (1 + self.e * np.sin(self.nu * t + self.phase)))

    def derivative(self, order, t, x):
        """Derivatives of this order of every Hamiltonian, (hamiltonian, .. order times 2 dof .., lane)."""
        return (self.sums[order] @ self.along(order, t, x)).reshape(-1, *(len(x),) * order, x.shape[1])

    # ---- the same as callables for the library: sums with weights w ----------------------------------------

    def _sum(self, order, t, w, q, p):
        x = np.concatenate([q, p])
        total = _product(self.wide_powers[order], w[self.j] * self.along(order, t, x))
        return total.reshape(*(len(x),) * order, x.shape[1])

    def _parts(self, g):
        return g[: self.ndof], g[self.ndof :]

    def value(self, t, w, q, p):
        return self._sum(0, t, w, q, p)

    def gradient(self, t, w, q, p):
        return self._parts(self._sum(1, t, w, q, p))

    def hessian(self, t, w, q, p):
        n, hess = self.ndof, self._sum(2, t, w, q, p)
        return hess[:n, :n], hess[n:, :n], hess[n:, n:]

    def hessian_vector(self, t, w, q, p, *v):
        moved = _product(self.wide, np.concatenate(v)) * w[self.j] * self.along(2, t, np.concatenate([q, p]))
        return self._parts(_product(self.wide_powers[1], moved))

    def third_derivative(self, t, w, q, p, *vectors):
        moved = w[self.j] * self.along(3, t, np.concatenate([q, p]))
        for place in (0, 2):
            moved = moved * _product(self.wide, np.concatenate(vectors[place : place + 2]))
        return self._parts(_product(self.wide_powers[1], moved))


class Forced:
    """A model of Hamiltonians with forces beside them: the field (H_p, -H_q + F), in rows of what takes the place of a
    gradient and of its derivative, which is not symmetric.

    A force of Hamiltonian j is a sum of v s sin(a.x + b + nu t), with vectors v (dof) and a (2 dof).
    """

    def __init__(self, model, pulls):
        """Pulls are (j, v, s, a, b, nu)."""
        self.model, self.ndof, self.nnoise, self.turn = model, model.ndof, model.nnoise, model.turn
        j, v, s, a, b, nu = zip(*pulls, strict=True)
        self.v = np.array(v, float) * np.array(s, float)[:, None]
        self.a, self.b, self.nu = np.array(a, float), np.array(b)[:, None], np.array(nu)[:, None]
        self.of = (np.arange(model.nnoise + 1)[:, None] == np.array(j)).astype(float)

    def _pulls(self, order, t, x):
        y = (self.a[:, :, None] * x).sum(axis=1) + self.b + self.nu * t
        return np.cos(y) if order else np.sin(y)

    def derivative(self, order, t, x):
        """Rows of the field (order 1) and of its derivatives (order 2); Hamiltonians alone have third ones."""
        found = self.model.derivative(order, t, x)
        if order in (1, 2):
            by = (self.a,) if order == 2 else ()
            terms = np.einsum("jr,ri,rl->jil" if order == 1 else "jr,ri,rl,ra->jial", self.of, self.v,
                              self._pulls(order - 1, t, x), *by)  # fmt: skip
            found[:, : self.ndof] -= terms
        return found

    def force(self, q, p, t):
        """F (dof, lane)."""
        return np.einsum("r,ri,rl->il", self.of[0], self.v, self._pulls(0, t, np.concatenate([q, p])))

    def noise_force(self, q, p, t):
        """f_k (noise, dof, lane)."""
        return np.einsum("jr,ri,rl->jil", self.of[1:], self.v, self._pulls(0, t, np.concatenate([q, p])))


def _product(matrix, x):
    """Product of a matrix (.., .., 1) with vectors; a lane has the same bits whichever lanes are beside it."""
    return np.add.reduce(matrix * x, axis=1)


@dataclass
class Drive:
    """The path over a step of size h: the polygon through rows of increments, (row, noise, lane)."""

    h: float
    w: np.ndarray  #: dW (noise, lane)
    z: np.ndarray  #: dZ
    k: np.ndarray  #: K
    areas: np.ndarray  #: A_kl (noise, noise, lane)
    magnus: np.ndarray  #: J_kl


def polygon(h, rows):
    """Functionals of the polygon by their integrals; J_kk less its mean over straight lines."""
    count = len(rows)
    part = h / count
    before = np.cumsum(rows, axis=0) - rows
    z_before = part * (np.cumsum(before + rows / 2, axis=0) - before - rows / 2)
    ends = np.arange(count + 1) / count
    square = np.diff(ends**3 / 3 - ends**2 / 2 + ends / 6) * count  # means of s^2 - s + 1/6
    half = np.einsum("ikl,iml->kml", before, rows) / 2
    j = np.einsum("ikl,iml->kml", z_before + part * (before / 2 + rows / 6), rows)
    magnus = (j + j.swapaxes(0, 1)) / 2 - np.eye(rows.shape[1])[:, :, None] * h * abs(h) / (15 * count)
    return Drive(h, rows.sum(axis=0), (part * (before + rows / 2)).sum(axis=0),
                 np.einsum("i,ikl->kl", square, rows) / 2, half - half.swapaxes(0, 1), magnus)  # fmt: skip


def iterate(image, x):
    """The fixed point of a contracting map."""
    for _ in range(200):
        x, before = image(x), x
        if np.abs(x - before).max() < 1e-15:
            return x
    raise ArithmeticError("the iteration of the reference does not end")


def solve(residual, x):
    """The root of a function of (unknown, lane), for each lane by itself."""
    size, eps = len(x), 1e-7
    for _ in range(30):
        r = residual(x)
        slopes = [(residual(x + eps * np.eye(size)[i][:, None]) - r) / eps for i in range(size)]
        dx = np.linalg.solve(np.moveaxis(np.array(slopes), (0, 1, 2), (2, 1, 0)), r.T[:, :, None])[:, :, 0].T
        x = x - dx
        if np.abs(dx).max() < 1e-14:
            return x
    raise ArithmeticError("Newton's method of the reference does not end")


# ---- the one-step Hamiltonian: its gradient (t, x) -> (2 dof, lane) --------------------------------


def pair(model, one, other):
    """Gradient and Hessian of {F,G} from (gradient, Hessian, third derivative) of both."""
    (f, ff, fff), (g, gg, ggg), turn = one, other, model.turn
    tg, ft = np.einsum("bc,cl->bl", turn, g), np.einsum("bl,bc->cl", f, turn)
    grad = np.einsum("abl,bl->al", ff, tg) + np.einsum("cl,cal->al", ft, gg)
    if fff is None:
        return grad, None
    mixed = np.einsum("abl,bc,cdl->adl", ff, turn, gg)
    hess = np.einsum("abdl,bl->adl", fff, tg) + mixed + mixed.swapaxes(0, 1) + np.einsum("cl,cadl->adl", ft, ggg)
    return grad, hess


class OneStep:
    """sum_j w_j H_j plus the parts named in `add` ("single", "areas", "nested", "crossed") and a correction."""

    def __init__(self, model, t, drive, add=(), *, correction=(0.0, ""), exact=True):
        """t: time at the begin of the step; exact: nested brackets by third derivatives, else by differences."""
        self.model, self.t, self.drive, self.add = model, t, drive, add
        self.correction, self.exact = correction, exact
        self.w = np.concatenate([np.full((1, drive.w.shape[1]), drive.h), drive.w])

    def __call__(self, t, x, w=None):
        w = self.w if w is None else w
        g = self.model.derivative(1, t, x)
        total = np.einsum("jl,jal->al", w, g)
        if self.correction[1]:
            total = total + self._correct(t, x, g)
        if self.add:
            total = total + self._brackets(t, x)
        return total

    def _correct(self, t, x, g):
        n, hess = self.model.ndof, self.model.derivative(2, t, x)
        factor, form = self.correction
        if form == "increments":
            g, hess = (np.einsum("kl,k...l->...l", self.drive.w, y[1:])[None] for y in (g, hess))
        else:
            g, hess, factor = g[1:], hess[1:], factor * abs(self.drive.h)
        return factor * np.einsum("kabl,kbl->al", hess, np.roll(g, n, axis=1))

    def _brackets(self, t, x):
        model, drive, h = self.model, self.drive, self.drive.h
        derivatives = [model.derivative(order, t, x) for order in (1, 2, 3)]
        jets = [tuple(d[j] for d in derivatives) for j in range(model.nnoise + 1)]
        noises = range(1, model.nnoise + 1)
        total = np.zeros_like(x)
        for k in noises:
            if "single" in self.add:
                c = h * drive.w[k - 1] / 2 - drive.z[k - 1]
                change = [model.derivative(1, at, x)[k] for at in (self.t, self.t + h)]
                total += c * pair(model, jets[k], jets[0])[0] + c / h * (change[1] - change[0])
            if "areas" in self.add:
                for other in range(1, k):
                    total += drive.areas[other - 1, k - 1] * pair(model, jets[k], jets[other])[0]
            if "nested" in self.add:
                total += h * abs(h) / 12 * self._nested(t, x, jets, k)
                ends = [tuple(model.derivative(o, at, x)[k] for o in (1, 2)) for at in (self.t + h, self.t)]
                total -= abs(h) / 12 * pair(model, *[(*end, None) for end in ends])[0]
        return total

    def _nested(self, t, x, jets, k):
        """Gradient of {{F/h, H_k}, H_k} with F = h H, or F = h H + sum_k dW_k H_k for the crossed bracket."""
        model, h = self.model, self.drive.h
        v = np.zeros_like(self.w)
        v[0] = 1
        if "crossed" in self.add and model.nnoise > 1:
            v[1:] = self.drive.w / h
        drift = tuple(sum(v[j] * jet[i] for j, jet in enumerate(jets)) for i in range(3))
        if self.exact:
            return pair(model, (*pair(model, drift, jets[k]), None), (*jets[k][:2], None))[0]
        unit = np.zeros_like(self.w)
        unit[k] = 1
        a, b, turn, eye = abs(h) / 2, np.sqrt(abs(h)) / 2, model.turn, np.eye(len(x))[:, :, None]
        move = [turn @ jet[0] for jet in (drift, jets[k])]
        slope = [np.einsum("ab,bcl->acl", turn, jet[1]) for jet in (drift, jets[k])]

        def at(weights, r, s):
            g = np.einsum("jl,jal->al", weights, model.derivative(1, t, x + r * move[0] + s * move[1]))
            return np.einsum("acl,al->cl", eye + r * slope[0] + s * slope[1], g)

        second = (at(v, 0, b) + at(v, 0, -b) - 2 * at(v, 0, 0)) / b**2
        mixed = sum(r * s * at(unit, r * a, s * b) for r in (-1, 1) for s in (-1, 1))
        return second - mixed / (4 * a * b)


# ---- tableaus and polynomials --------------------------------------------------------------------


def rule(name):
    """Nodes and weights on [0, 1]: gauss3, lobatto3, otr."""
    if name == "otr":
        return np.array([1, 2]) / 3, np.array([0.5, 0.5])
    family, count = name[:-1], int(name[-1])
    if family == "gauss":
        x, w = np.polynomial.legendre.leggauss(count)
        return (x + 1) / 2, w / 2
    inner = np.polynomial.legendre.Legendre.basis(count - 1).deriv().roots()
    x = np.sort(np.concatenate([[-1.0], inner, [1.0]]))
    w = 2 / (count * (count - 1) * np.polynomial.legendre.Legendre.basis(count - 1)(x) ** 2)
    return (x + 1) / 2, w / 2


def collocation(c, alpha):
    """a_ij, the integrals of the Lagrange polynomials from 0 to c_i, and the symplectic conjugate."""
    powers = np.vander(c, increasing=True)
    integrals = c[:, None] ** np.arange(1, len(c) + 1) / np.arange(1, len(c) + 1)
    a = integrals @ np.linalg.inv(powers)
    return a, alpha - alpha * a.T / alpha[:, None]


SAME = {"midpoint": "gauss1", "stormer_verlet": "lobatto2", "P2N2Q2Lob": "lobatto2", "P2N2Q2Otr": "otr"}


def tableau_of(name):
    """(a, abar, alpha, c) of a scheme of the catalogue."""
    family, _, number = name.partition(":")
    if family == "lambda":
        x = float(number)
        return np.array([[x]]), np.array([[1 - x]]), np.ones(1), np.array([x])
    if family == "dirk":
        x = float(number)
        a = np.array([[x / 2, 0], [x, (1 - x) / 2]])
        return a, a, np.array([x, 1 - x]), a.sum(axis=1)
    if name == "heun":
        a = np.array([[0.0, 0], [1, 0]])
        return a, a, np.ones(2) / 2, np.array([0.0, 1])
    name = SAME.get(name, name)
    c, alpha = rule(name.removesuffix("_swapped"))
    a, abar = collocation(c, alpha)
    return (abar, a, alpha, c) if name.endswith("_swapped") else (a, abar, alpha, c)


def tableau_step(hhat, tableau, x):
    """A step by the slopes of all stages at once; `hhat` is a OneStep."""
    a, abar, alpha, c = tableau
    n, lanes, s = hhat.model.ndof, x.shape[1], len(alpha)

    def stages(k):
        moves = [np.einsum("ij,jal->ial", b, y) for b, y in ((a, k[:, :n]), (abar, k[:, n:]))]
        at = x + np.concatenate(moves, axis=1)
        turn, h = hhat.model.turn, hhat.drive.h
        return np.array([turn @ hhat(hhat.t + ci * h, point) for ci, point in zip(c, at, strict=True)])

    k = iterate(stages, np.zeros((s, 2 * n, lanes)))
    return x + np.einsum("i,ial->al", alpha, k)


def galerkin_step(hhat, degree, nodes, x):
    """A step by polynomials of this degree through equally spaced control points, with momenta at the nodes."""
    c, alpha = nodes
    n, lanes, r, h = hhat.model.ndof, x.shape[1], len(c), hhat.drive.h
    at = np.arange(degree + 1) / degree
    basis = [np.polynomial.Polynomial(row) for row in np.linalg.inv(np.vander(at, increasing=True)).T]
    values, slopes = (np.array([[y(ci) for y in ys] for ci in c]) for ys in (basis, [y.deriv() for y in basis]))

    def unpack(y):
        y = y.reshape(degree + r, n, lanes)
        q = np.concatenate([x[None, :n], x[None, :n] + y[:degree]])
        points = np.concatenate([np.einsum("im,mal->ial", values, q), x[n:] + y[degree:]], axis=1)
        g = np.array([hhat(hhat.t + ci * h, point) for ci, point in zip(c, points, strict=True)])
        return q, points[:, n:], g

    def residual(y):
        q, momenta, g = unpack(y)
        velocity = np.einsum("im,mal->ial", slopes, q) - g[:, n:]
        left = np.einsum("i,im,ial->mal", alpha, slopes, momenta) - np.einsum("i,im,ial->mal", alpha, values, g[:, :n])
        left[0] += x[n:]
        return np.concatenate([velocity, left[:degree]]).reshape(y.shape)

    y = solve(residual, np.zeros(((degree + r) * n, lanes)))
    q, _, g = unpack(y)
    return np.concatenate([q[-1], x[n:] - np.einsum("i,ial->al", alpha, g[:, :n])])


# ---- kicks and drifts ------------------------------------------------------------------------------


@dataclass
class Kicks:
    """Coefficients of docs/method/explicit.md; `beta` and `share` are b unless given."""

    c: tuple
    b: tuple
    gamma: tuple = (0, 0, 0)
    eta: tuple = (0, 0, 0)
    kappa: tuple = (0, 0, 0)
    zeta: float = 0.0
    beta: tuple = ()
    share: tuple = ()


_X, _R = (1 - 3**-0.5) / 2, 3**0.5
KICKS = {
    "gauss_dkdkd": Kicks((_X, 1 - _X), (1 / 2, 1 / 2), (_R, -_R)),
    "verlet_kdk": Kicks((0, 1), (1 / 2, 1 / 2), (1, -1)),
    "chin4a": Kicks(
        (0, 1 / 2, 1), (1 / 6, 2 / 3, 1 / 6), (1, 0, -1), (4, -8, 4), (0, -1 / 72, 0), -12.0, share=(0, 1, 0)
    ),
    "verlet_dkd": Kicks((1 / 2,), (1,)),
    "exact_rotation": Kicks((0, 1), (1 / 2, 1 / 2), beta=(1, 0)),
}


def kicks_step(model, name, t, drive, x, *, rotation=None, rates=None, split=None):
    """A step of kicks with drifts, rotations, midpoint steps or drifts that decay by rates between them; or with flows
    of a quadratic part, by its second derivatives `split`."""
    kicks = KICKS[next(key for key in KICKS if name.startswith(key))]
    n, h, m = model.ndof, drive.h, model.nnoise
    beta, share = kicks.beta or kicks.b, kicks.share or kicks.b
    midpoint, sampled = name.endswith("_midpoint"), name.endswith("_strong2")
    a = drive.z / h - drive.w / 2
    w = [beta[i] * drive.w + kicks.gamma[i] * a + kicks.eta[i] * drive.k for i in range(len(beta))]
    free = not midpoint and rotation is None and split is None
    if free and rates is not None and len(set(rates)) == 1:  # the noise of free motion has its law
        nodes = 1 - np.array(kicks.c)
        phi = [_reach(rates[0] * h, u) for u in nodes]
        rest = _law(rates[0] * h, drive.w, a, drive.k, name.startswith("chin"))
        rest = (rest - sum(f * y for f, y in zip(phi, w, strict=True))) / (phi[0] - phi[-1])
        w[0], w[-1] = w[0] + rest, w[-1] - rest
    pairs = list(itertools.combinations(range(len(beta)), 2))
    mean = sum((kicks.c[j] - kicks.c[i]) * (beta[i] * beta[j] + kicks.gamma[i] * kicks.gamma[j] / 12
               + kicks.eta[i] * kicks.eta[j] / 720) for i, j in pairs)  # fmt: skip
    mean -= 2 * sum(kicks.kappa) * (1 + kicks.zeta**2 / 720)
    d = mean * h * abs(h) * np.eye(m)[:, :, None]
    v = drive.w + kicks.zeta * drive.k
    if name in {"exact_rotation", "verlet_dkd_weak2"}:
        d = 0 * d
    if sampled:
        outer = partial(np.einsum, "kl,ml->kml")
        d = sum(h * (kicks.c[j] - kicks.c[i]) * (outer(w[i], w[j]) + outer(w[j], w[i])) / 2 for i, j in pairs)
        d = d - 2 * sum(kicks.kappa) * h * outer(v, v) - drive.magnus
    flow, stiffness = _flow_between(model, rotation, rates, split, midpoint)
    place = 0.0
    for i, ci in enumerate(kicks.c):
        x = flow(t + place * h, (ci - place) * h, x)
        place = ci
        at = x if split is None else np.concatenate([x[:n], 0 * x[n:]])
        g, hess = (model.derivative(order, t + ci * h, at) for order in (1, 2))
        mass = model.derivative(2, t, x)[0, n:, n:]
        g, hess = g[:, :n], hess[:, :n, :n]
        g[0] -= stiffness @ x[:n]
        hess[0] -= stiffness[:, :, None]
        drift = 0.0 if midpoint else kicks.b[i] * h
        force = drift * g[0] + np.einsum("kl,kal->al", w[i], g[1:])
        sums = [h * y[0] + np.einsum("kl,k...l->...l", v, y[1:]) for y in (g, hess)]
        force = force + 2 * kicks.kappa[i] * h * np.einsum("abl,bcl,cl->al", sums[1], mass, sums[0])
        force = force + share[i] * np.einsum("kabl,bcl,kml,mcl->al", hess[1:], mass, d + 0 * v, g[1:])
        x = np.concatenate([x[:n], x[n:] - force])
    x = flow(t + place * h, (1 - place) * h, x)
    if rates is None or midpoint or name == "exact_rotation" or (free and len(set(rates)) == 1):
        return x
    coefficients = [(c, (beta[i], kicks.gamma[i], kicks.eta[i])) for i, c in enumerate(kicks.c)]
    return x + _rest_of_law(model, flow, t, drive, kicks=coefficients, known=3 if name.startswith("chin") else 2)


def _rest_of_law(model, flow, t, drive, *, kicks, known, shift=None):
    """What the law of the noise of a linear drift adds to that of kicks, if noises are constant: the factor of the
    covariance times the polar factor of the means given dW, a and K; integrals by Gauss' rule, and the polar factor by
    singular values. Zero where there are fewer normals than dimensions; noises that push alike count once.
    """
    n, m, h = model.ndof, model.nnoise, drive.h
    origin = np.zeros((2 * n, 1))
    push = -model.derivative(1, t, origin)[1:, :, 0]
    changes = [
        model.derivative(1, t + 1, origin)[1:, :, 0] + push,
        model.derivative(1, t, origin + 0.3)[1:, :, 0] + push,
    ]
    if not m or np.abs(changes).max() > 0:
        return 0.0
    noise = np.concatenate([np.zeros((n, m)), push[:, :n].T])
    s, weight = rule("gauss9")
    s, weight = np.concatenate([s, 1 + s]) / 2, np.concatenate([weight, weight]) / 2
    kernel = np.array([flow(t, u * h, np.eye(2 * n)) @ noise for u in s])  # (node, component, noise)
    shape = np.array([s**0, np.sqrt(12) * (s - 1 / 2), np.sqrt(720) * (s**2 - s + 1 / 6) / 2])[:known]
    size = np.sqrt(np.einsum("u,uik,uik->i", weight, kernel, kernel))
    value, vector = np.linalg.eigh(np.einsum("u,uik,ujk->ij", weight, kernel, kernel) / np.outer(size, size))
    value, vector = value[value > 1e-12], vector[:, value > 1e-12]
    if len(value) > known * np.linalg.matrix_rank(noise, 1e-7):
        return 0.0
    factor = vector * np.sqrt(value)
    means = np.einsum("u,ru,uik->ikr", weight, shape, kernel).reshape(2 * n, -1) / size[:, None]
    left, _, right = np.linalg.svd(factor.T / value[:, None] @ means, full_matrices=False)
    law = (size[:, None] * (factor @ left @ right)).reshape(2 * n, m, known) * np.sqrt([1, 12, 720])[:known]
    given = [drive.w, drive.z / h - drive.w / 2, drive.k][:known]
    rest = sum(law[:, :, r] @ given[r] for r in range(known))
    for c, by in kicks:
        rest = rest - flow(t, (1 - c) * h, np.eye(2 * n)) @ noise @ sum(x * y for x, y in zip(by, given, strict=False))
    return rest if shift is None else rest - shift(noise @ given[1])


def _reach(z, u):
    """(1 - exp(-z u))/z."""
    return -np.expm1(-z * u) / z


def _law(z, w, a, k, third):
    """D/h = int phi(1 - s) dW/h from dW, a and K, with its variance: by projections, integrals by Gauss' rule."""
    s, weight = rule("gauss9")
    phi = _reach(z, 1 - s)
    on_w, on_a = weight @ phi, 12 * weight @ (phi * (0.5 - s))
    if not third:
        return on_w * w + np.sqrt(12 * (weight @ phi**2 - on_w**2)) * a
    left = weight @ phi**2 - on_w**2 - on_a**2 / 12
    return on_w * w + on_a * a - np.sign(z) * np.sqrt(720 * left) * k


def _decay_flow(model, rates, t, h, x):
    """Free motion with damped momenta; the mass is constant."""
    n = model.ndof
    mass = model.derivative(2, t, x)[0, n:, n:]
    tau = -np.expm1(-rates * h) / rates
    return np.concatenate([x[:n] + np.einsum("bcl,cl->bl", mass, tau * x[n:]), np.exp(-rates * h) * x[n:]])


def _turn_decay_flow(omega, rates, _t, h, x):
    """The same under p.p/2 + sum omega^2 q^2/2, for every degree of freedom the exponential of a matrix of two rows."""
    n = len(omega)
    moved = [exponential(h * np.array([[0, 1], [-(o**2), -r]])) @ x[[k, n + k]] for k, (o, r) in
             enumerate(zip(omega, rates, strict=True))]  # fmt: skip
    return np.concatenate(np.swapaxes(moved, 0, 1))


def _flow_between(model, rotation, rates, split, midpoint):
    """The flow between two kicks, and the stiffness that it includes."""
    n = model.ndof
    omega = np.zeros(n) if rotation is None else np.array(rotation)
    flow, stiffness = partial(_midpoint_flow if midpoint else _turn_flow, model, omega), np.diag(omega**2)
    if split is not None:
        stiffness, field = split[:n, :n], np.concatenate([split[n:], -split[:n]])
        return partial(_linear_flow, field - np.diag([*0 * omega, *(0 * omega if rates is None else rates)])), stiffness
    if rates is not None:
        flow = partial(_decay_flow, model, np.array(rates)[:, None])
        if midpoint:
            flow = partial(_midpoint_decay_flow, model, np.array(rates))
        elif rotation is not None:
            flow = partial(_turn_decay_flow, omega, np.array(rates))
    return flow, stiffness


def _linear_flow(field, _t, h, x):
    return exponential(h * field) @ x


def exponential(matrix):
    """exp(matrix), by 20 terms of the series of a small part of it and squares."""
    squares = max(0, int(np.ceil(np.log2(np.abs(matrix).sum(axis=1).max() + 1e-300))) + 2)
    total = term = np.eye(len(matrix))
    for k in range(1, 21):
        term = term @ matrix / (k * 2.0**squares)
        total = total + term
    return np.linalg.matrix_power(total, 2**squares)


def _midpoint_decay_flow(model, rates, t, h, x):
    """A midpoint step between two halves of the decay."""
    half = np.exp(-np.concatenate([0 * rates, rates]) * h / 2)[:, None]
    return half * _midpoint_flow(model, None, t, h, half * x)


class Clocked:
    """The Hamiltonians of P = exp(gamma (t - t_n)) p, whose steps from t_n are those of damped momenta.

    Of unequal rates only the field is there, which is no Hamiltonian's.
    """

    def __init__(self, model, t, rates):
        """t: time t_n at the begin of the step; rates (ndof,)."""
        self.model, self.t, self.rates = model, t, np.array(rates)[:, None]
        self.ndof, self.nnoise, self.turn = model.ndof, model.nnoise, model.turn

    def derivative(self, order, t, x):
        """Derivatives by q and P."""
        n, grow = self.ndof, np.exp(self.rates * (t - self.t))
        found = self.model.derivative(order, t, np.concatenate([x[:n], x[n:] / grow]))
        if order == 1:
            return found * np.concatenate([grow, np.ones_like(grow)])
        shape = np.concatenate([np.ones(n), 1 / grow[:, 0]])
        for i in range(order):
            found = found * shape.reshape([-1 if i == j else 1 for j in range(order)] + [1])
        return grow[0, 0] * found


def damped_step(name, model, t, drive, x, *, rates, **how):
    """The same with damped momenta, by kicks or by a clock."""
    if "kdk" in name or "dkd" in name or "chin" in name or name == "exact_rotation":
        return kicks_step(model, name, t, drive, x, rates=rates, rotation=how.get("rotation"))
    if name == "verlet_dz":
        return damped_verlet_dz_step(model, t, drive, x, np.array(rates)[:, None])
    x = step(name, Clocked(model, t, rates), t, drive, x, **how)
    return x * np.exp(-np.concatenate([np.zeros(model.ndof), rates]) * drive.h)[:, None]


def _turn_flow(model, omega, t, h, x):
    """The exact flow of p.M^-1 p/2 + sum omega^2 q^2/2."""
    n = model.ndof
    q, p, o = x[:n], x[n:], omega[:, None]
    if not omega.any():
        inverse = model.derivative(2, t, x)[0, n:, n:]
        return np.concatenate([q + h * np.einsum("abl,bl->al", inverse, p), p])
    c, s = np.cos(o * h), np.sin(o * h)
    over = np.where(o == 0, h, s / np.where(o == 0, 1, o))
    return np.concatenate([c * q + over * p, c * p - o * s * q])


def _midpoint_flow(model, _omega, t, h, x):
    if h == 0:
        return x
    none = np.zeros((model.nnoise, x.shape[1]))
    return tableau_step(OneStep(model, t, Drive(h, none, none, none, none, none)), tableau_of("midpoint"), x)


# ---- schemes of some noise alone, contrasts --------------------------------------------------------


def _ends(model, t, h, x):
    """Fields B_k of additive noises at the beginning, the middle and the end of the step, (noise, 2 dof, lane)."""
    return [np.einsum("ab,kbl->kal", model.turn, model.derivative(1, at, x)[1:]) for at in (t, t + h / 2, t + h)]


def _change(model, t, drive, x):
    """The part of int B dW due to the change of B: -(B_1 - B_0) a."""
    begin, _, end = _ends(model, t, drive.h, x)
    return np.einsum("kl,kal->al", drive.w / 2 - drive.z / drive.h, end - begin)


def verlet_dz_step(model, t, drive, x):
    n, h = model.ndof, drive.h
    half = x[:n] + h / 2 * x[n:]
    p = x[n:] - h * model.derivative(1, t + h / 2, np.concatenate([half, x[n:]]))[0, :n]
    middle = _ends(model, t, h, x)[1]
    p = p + (np.einsum("kl,kal->al", drive.w, middle) + _change(model, t, drive, x))[n:]
    last = np.einsum("kl,kal->al", drive.z - h * drive.w / 2, middle)[n:]
    return np.concatenate([half + h / 2 * p + last, p])


def damped_verlet_dz_step(model, t, drive, x, rates):
    """The same between half drifts that decay; with one rate q and p receive D and W - gamma D."""
    n, h = model.ndof, drive.h
    flow = partial(_decay_flow, model, rates, t, h / 2)
    half = flow(x)
    p = half[n:] - h * model.derivative(1, t + h / 2, half)[0, :n]
    middle = _ends(model, t, h, x)[1]
    shift = drive.z - h * drive.w / 2
    if len(set(rates[:, 0])) == 1:
        a = drive.z / h - drive.w / 2
        shift = h * (_law(rates[0, 0] * h, drive.w, a, drive.k, third=False) - _reach(rates[0, 0] * h, 1 / 2) * drive.w)
    kick = np.einsum("kl,kal->al", drive.w, middle)
    begin, _, end = _ends(model, t, h, x)
    kick = kick - np.einsum("kl,kal->al", shift / h, end - begin)
    x = flow(np.concatenate([half[:n], p + kick[n:]]))
    moved = np.einsum("kl,kal->al", shift, middle)[n:]
    x = x + np.concatenate([moved, -rates * moved])
    if len(set(rates[:, 0])) == 1:
        return x

    def shifted(kick):
        return h * np.concatenate([kick[n:], -rates * kick[n:]])

    whole = partial(_decay_flow, model, rates)
    return x + _rest_of_law(model, whole, t, drive, kicks=[(1 / 2, (1, 0, 0))], known=2, shift=shifted)


def averaged_shift_step(model, t, drive, x, exact):
    h, middle, change = drive.h, _ends(model, t, drive.h, x)[1], _change(model, t, drive, x)
    around = np.einsum("kl,kal->al", drive.z / h, middle) + change / 2

    def slope(z):
        at = (x + z) / 2 + around
        g = h * model.derivative(1, t + h / 2, at)[0]
        for b in middle:
            if exact:
                g = g + h * abs(h) / 12 * np.einsum("abcl,bl,cl->al", model.derivative(3, t + h / 2, at)[0], b, b)
            else:
                r = np.sqrt(abs(h)) / 2
                terms = [model.derivative(1, t + h / 2, at + s * r * b)[0] for s in (1, 0, -1)]
                g = g + h * abs(h) / 12 * (terms[0] - 2 * terms[1] + terms[2]) / r**2
        return model.turn @ g

    return iterate(lambda z: x + slope(z), x) + np.einsum("kl,kal->al", drive.w, middle) + change


def drift_preserving_step(model, t, drive, x):
    n, h = model.ndof, drive.h
    c, alpha = rule("gauss4")
    kick = -np.einsum("kl,kal->al", drive.w, model.derivative(1, t + h / 2, x)[1:, :n])

    def force(psi):
        points = [np.concatenate([x[:n] + ci * h * psi, psi]) for ci in c]
        return sum(a * h * model.derivative(1, t + h / 2, y)[0, :n] for a, y in zip(alpha, points, strict=True))

    psi = iterate(lambda psi: x[n:] + kick - force(psi) / 2, x[n:])
    return np.concatenate([x[:n] + h * psi, x[n:] + kick - force(psi)])


def euler_maruyama_step(model, t, drive, x):
    g, hess = model.derivative(1, t, x), model.derivative(2, t, x)
    fields = np.einsum("ab,jbl->jal", model.turn, g)
    ito = np.einsum("ab,kbcl,kcl->al", model.turn, hess[1:], fields[1:]) / 2
    return x + drive.h * fields[0] + abs(drive.h) * ito + np.einsum("kl,kal->al", drive.w, fields[1:])


ADDED = {
    "gauss2_strong32": ("gauss2", ("single", "nested")),
    "gauss2_strong32_areas": ("gauss2", ("single", "areas", "nested")),
    "gauss2_weak2": ("gauss2", ("nested",)),
    "gauss2_weak2_areas": ("gauss2", ("areas", "nested", "crossed")),
    "midpoint_areas": ("midpoint", ("areas",)),
    "midpoint_weak1": ("midpoint", ()),
}
EULER = {"symplectic_euler": "lambda:0", "symplectic_euler_adjoint": "lambda:1"}


def step(name, model, t, drive, x, *, correction="increments", exact=True, rotation=None):
    """The state after one step of the scheme from x at time t."""
    name = EULER.get(name, name)
    own = {
        "verlet_dz": verlet_dz_step,
        "drift_preserving": drift_preserving_step,
        "euler_maruyama": euler_maruyama_step,
    }
    if name in own:
        return own[name](model, t, drive, x)
    if name == "averaged_shift_midpoint":
        return averaged_shift_step(model, t, drive, x, exact)
    if "kdk" in name or "dkd" in name or "chin" in name or name == "exact_rotation":
        return kicks_step(model, name, t, drive, x, rotation=rotation)
    base, add = ADDED.get(name, (name, ()))
    if base[0] == "P" and base[1] != base[3]:
        nodes = "otr" if base.endswith("Otr") else {"Gau": "gauss", "Lob": "lobatto"}[base[6:]] + base[3]
        return galerkin_step(OneStep(model, t, drive), int(base[1]), rule(nodes), x)
    form = correction if base.startswith("lambda") else ""
    factor = 0.5 - float(base.partition(":")[2]) if form else 0.0
    hhat = OneStep(model, t, drive, add, correction=(factor, "" if form == "none" else form), exact=exact)
    return tableau_step(hhat, tableau_of(base), x)
