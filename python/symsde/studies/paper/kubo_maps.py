# SPDX-License-Identifier: BSD-3-Clause
"""One step of every scheme on the Kubo oscillator as a matrix, written down independently of the library.

The Kubo oscillator is linear with one-step Hamiltonian x (p^2+q^2)/2, x = a h + sigma dW, so that a step is a 2 x 2
matrix acting on (q, p). All functions take arrays x and return matrices of shape x.shape + (2, 2).
"""

import numpy as np

_ROOT = np.sqrt(3.0) / 6

# Tableaux by name: a of the positions; the momenta have the symplectic conjugate abar_ij = alpha_j - alpha_j a_ji /
# alpha_i.
TABLEAUX = {
    "midpoint": ([[0.5]], [1.0]),
    "gauss2": ([[0.25, 0.25 - _ROOT], [0.25 + _ROOT, 0.25]], [0.5, 0.5]),
    "lobatto3": ([[0, 0, 0], [5 / 24, 1 / 3, -1 / 24], [1 / 6, 2 / 3, 1 / 6]], [1 / 6, 2 / 3, 1 / 6]),
    "stormer_verlet": ([[0, 0], [0.5, 0.5]], [0.5, 0.5]),
}


def tableau(name, x):
    """Solve Q = q + x a P, P = p - x abar Q for the stages; q' = q + x alpha P, p' = p - x alpha Q."""
    a, alpha = (np.array(item) for item in TABLEAUX[name])
    conjugate = alpha - alpha * a.T / alpha[:, None]
    r = alpha.size
    x = x[..., None, None]
    top = np.concatenate([np.broadcast_to(np.eye(r), (*x.shape[:-2], r, r)), -x * a], axis=-1)
    low = np.concatenate([x * conjugate, np.broadcast_to(np.eye(r), (*x.shape[:-2], r, r))], axis=-1)
    ones = np.kron(np.eye(2), np.ones((r, 1)))
    stages = np.linalg.solve(np.concatenate([top, low], axis=-2), np.broadcast_to(ones, (*x.shape[:-2], 2 * r, 2)))
    weights = np.kron(np.array([[0.0, 1.0], [-1.0, 0.0]]), alpha)
    return np.eye(2) + x * (weights @ stages)


def symplectic_euler(x, c):
    """(89)-(90) for x (p^2+q^2)/2 + c p q with the correction c: p' = p - x q - c p', q' = q + x p' + c q."""
    p_from_q, p_from_p = -x / (1 + c), 1 / (1 + c)
    return _matrix(1 + c + x * p_from_q, x * p_from_p, p_from_q, p_from_p)


def symplectic_euler_adjoint(x, c):
    """(91)-(92) for x (p^2+q^2)/2 - c p q: q' = q + x p - c q', p' = p - x q' + c p."""
    q_from_q, q_from_p = 1 / (1 + c), x / (1 + c)
    return _matrix(q_from_q, q_from_p, -x * q_from_q, 1 + c - x * q_from_p)


def heun(x):
    """1 + i x + (i x)^2 / 2 as a matrix, where q + i p is multiplied by -i per unit of angle."""
    return _complex(1 - x**2 / 2, x)


def euler_maruyama(x, drift):
    """Ito form: the drift (sigma^2/2) h is subtracted from both components."""
    return _complex(1 - drift, x)


def fixed_point_midpoint(x, iterations):
    """The midpoint rule z' = z + x J (z + z')/2, iterated a fixed number of times from z' = z."""
    step = np.ones_like(x, dtype=complex)
    for _ in range(iterations):
        step = 1 + 0.5j * x * (1 + step)
    return _complex(step.real, step.imag)


def determinant_defect(matrices):
    """det M - 1, the change of area by one step; with one degree of freedom a map is symplectic if it is 0."""
    return np.linalg.det(matrices) - 1


def follow(matrices, q, p):
    """Apply matrices (step, path, 2, 2) one after the other; q, p (step + 1, path)."""
    z = np.empty((matrices.shape[0] + 1, matrices.shape[1], 2))
    z[0] = q, p
    for n, matrix in enumerate(matrices):
        z[n + 1] = np.einsum("kij,kj->ki", matrix, z[n])
    return z[..., 0], z[..., 1]


def _matrix(qq, qp, pq, pp):
    qq, qp, pq, pp = np.broadcast_arrays(qq, qp, pq, pp)
    return np.stack([np.stack([qq, qp], axis=-1), np.stack([pq, pp], axis=-1)], axis=-2)


def _complex(cosine, sine):
    return _matrix(cosine, sine, -sine, cosine)
