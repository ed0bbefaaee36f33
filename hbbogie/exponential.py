"""Exponentials of matrices over many durations, and their derivatives, by a Taylor polynomial with squaring.

A Taylor polynomial needs no inverse and no eigenvectors. It is therefore just as accurate if eigenvectors coincide, as
they do for a free mass. The number of squarings follows from the fourth power, which the polynomial needs anyway (A. H.
Al-Mohy, N. J. Higham, A new scaling and squaring algorithm for the matrix exponential, SIAM J. Matrix Anal. Appl. 31
(2010) 970-989; the evaluation is that of M. S. Paterson and L. J. Stockmeyer, SIAM J. Comput. 2 (1973) 60-66).
"""

from __future__ import annotations

from math import factorial

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

REACH = 0.29  # size up to which the Taylor polynomial of degree 12 is accurate to round-off
HALVES = 3  # smallest number of squarings; they also give the transitions over 1/2, 1/4 and 1/8 of each duration
# coefficients of A^1 ... A^4 in the three blocks of the polynomial, and those of the identity
_BLOCKS = np.array([[1 / factorial(4 * k + j) for j in range(1, 5)] for k in range(3)])
_BLOCKS[:2, 3] = 0.0  # A^4 and A^8 come in with the identity of the next block
_IDENTITY = np.array([1 / factorial(4 * k) for k in range(3)])
_ORDERS = np.add.outer(np.arange(0, 12, 4), np.arange(1, 5))


def exponentials(A: Array, of: NDArray[np.int_], h: Array) -> list[Array]:
    """Return the exponentials of A h / 8, A h / 4, A h / 2 and A h.

    Parameters
    ----------
    A : ndarray, shape (B, U, N, N)
        U matrices of each of B cycles.
    of : ndarray of int, shape (S,)
        Which of them acts in each phase.
    h : ndarray, shape (B, S)
        Duration of each phase.

    Returns
    -------
    list of ndarray, each of shape (B, S, N, N)
    """
    return _exponentials(A, of, h)


def exponentials_with_derivative(A: Array, D: Array, of: NDArray[np.int_], h: Array) -> tuple[list[Array], Array]:
    """Return what `exponentials` does, and the derivative of exp((A + t D) h) in t at t = 0.

    Parameters
    ----------
    A, D : ndarray, shape (B, U, N, N)
    of : ndarray of int, shape (S,)
    h : ndarray, shape (B, S)
    """
    N = A.shape[-1]
    both = _exponentials(np.concatenate([A, D], axis=-2), of, h)
    return [e[:, :, :N] for e in both], both[-1][:, :, N:]


def _exponentials(A: Array, of: NDArray[np.int_], h: Array) -> list[Array]:
    """Return the exponentials of a stack, with their derivatives where those of the matrices are given below them."""
    powers = _powers(A)
    N = A.shape[-1]
    s, order, back = _squarings(powers[:, :, 3, :N], of, h)
    of = of[order]
    scaled = (h[:, order] * 2.0**-s)[..., None, None]
    coefficients = _BLOCKS * scaled**_ORDERS
    mine = powers[:, of]
    blocks = (coefficients @ mine.reshape(*mine.shape[:3], -1)).reshape(*mine.shape[:2], 3, *mine.shape[3:])
    k = np.arange(N)
    blocks[..., k, k] += (_IDENTITY * scaled[..., 0] ** (0, 4, 8))[..., None]
    A4 = mine[:, :, 3]
    E = _times(_times(blocks[:, :, 2], A4) + blocks[:, :, 1], A4) + blocks[:, :, 0]
    most, levels = int(s[0]), []
    for j in range(most):
        if j >= most - HALVES:
            levels.append(E)
            E = _times(E, E)
        else:
            at_work = slice(int(np.count_nonzero(s >= most - j)))
            E[:, at_work] = _times(E[:, at_work], E[:, at_work])
    levels.append(E)
    return levels if back is None else [e[:, back] for e in levels]


def _times(P: Array, Q: Array) -> Array:
    """Return the product P Q, and below it P dQ + dP Q where the derivatives stand below P and Q."""
    N = P.shape[-1]
    product = P @ Q[..., :N, :]
    if P.shape[-2] > N:
        product[..., N:, :] += P[..., :N, :] @ Q[..., N:, :]
    return product


def _powers(A: Array) -> Array:
    """Return A, A^2, A^3, A^4, shape (B, U, 4, ...), with their derivatives below."""
    powers = np.empty((*A.shape[:2], 4, *A.shape[2:]))
    powers[:, :, 0] = A
    powers[:, :, 1] = A2 = _times(A, A)
    powers[:, :, 2], powers[:, :, 3] = _times(A2, A), _times(A2, A2)
    return powers


def _squarings(
    A4: Array, of: NDArray[np.int_], h: Array
) -> tuple[NDArray[np.int_], NDArray[np.int_], NDArray[np.int_] | None]:
    """Return the number of squarings of each phase, largest first, the order of the phases, and the inverse order.

    The inverse order is None if the phases are in that order already.
    """
    size = np.einsum("buij,buij->bu", A4, A4) ** 0.125
    largest = (size[:, of] * np.abs(h)).max(axis=0, initial=1e-300)
    s = np.maximum(HALVES, np.ceil(np.log2(largest / REACH)).astype(int))
    order = np.argsort(-s, kind="stable")
    return s[order], order, None if (order[1:] > order[:-1]).all() else np.argsort(order)
