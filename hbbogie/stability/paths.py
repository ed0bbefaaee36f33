"""Motions on elements with Gauss points: the order of contacts, the path, and what Newton's method needs of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
STAGES = 12  # Gauss points of an element, which give order 24 at its ends


def _integrals(x: Array) -> Array:
    """Return the integrals from -1 to x of the Legendre polynomials 0 ... STAGES - 1, shape (len(x), STAGES)."""
    P = legendre.legvander(x, STAGES)
    k = np.arange(1, STAGES)
    return np.column_stack([x + 1, (P[:, 2:] - P[:, :-2]) / (2 * k + 1)])


_x, _w = legendre.leggauss(STAGES)
NODES, WEIGHTS = (_x + 1) / 2, _w / 2
TO_LEGENDRE = np.linalg.inv(legendre.legvander(_x, STAGES - 1))
INTEGRATE = _integrals(_x) @ TO_LEGENDRE / 2


@dataclass(frozen=True, eq=False)
class Pattern:
    """The order of contacts over a period: S segments, each of which begins when a contact changes its line.

    Attributes
    ----------
    starts, lengths : ndarray, shape (S,), rad
        Phases at which the segments begin, and their lengths.
    contact, level : ndarray, shape (S,) or (0,), the level in the unit of the contact's argument
        The contact that begins each segment, and its level; empty if no contact changes its line.
    lines : ndarray, shape (S, 2 contacts)
        Slope and intercept of each contact.
    """

    starts: Array
    lengths: Array
    contact: NDArray[np.int_]
    level: Array
    lines: Array


@dataclass(frozen=True, eq=False)
class Path:
    """A motion on N elements, in scaled states.

    Attributes
    ----------
    segment, share : ndarray, shape (N,)
        The segment in which each element lies, and its share of the segment's duration.
    x, stages : ndarray, shape (N, n_states) and (N, STAGES, n_states)
        States where the elements begin, and at their Gauss points.
    durations : ndarray, shape (S,), s
    """

    segment: NDArray[np.int_]
    share: Array
    x: Array
    stages: Array
    durations: Array

    @property
    def h(self) -> Array:
        """Duration of each element, shape (N,), s."""
        return self.durations[self.segment] * self.share


@dataclass(frozen=True, eq=False)
class NewtonStep:
    """Equations and derivatives at a path; the stages of each element are eliminated.

    Attributes
    ----------
    f, error : ndarray, shape (N, STAGES, n_states), 1/s, and float
        Rates at the stages, and the largest residual of all equations.
    gap : ndarray, shape (N, n_states)
        End of each element, with its stages solved for, minus the beginning of the next.
    transitions, drift : ndarray, shape (N, n_states, n_states) and (N, n_states)
        Derivatives of the end in the beginning and in the duration.
    response : ndarray, shape (N, STAGES, n_states, n_states + 2)
        Stages: correction, derivative in the beginning, derivative in the duration; of many states nothing.
    off, slope : ndarray, shape (S,) and (S, n_states)
        The arguments of the contacts minus their levels, scaled, and derivatives.
    """

    f: Array
    error: float
    gap: Array
    transitions: Array
    drift: Array
    response: Array
    off: Array
    slope: Array


def states_at(path: Path, f: Array, element: NDArray[np.int_], sigma: ArrayLike) -> Array:
    """Return scaled states inside elements, sigma from 0 to 1, shape (len(sigma), n_states)."""
    basis = _integrals(2 * np.asarray(sigma) - 1) @ TO_LEGENDRE / 2
    return path.x[element] + path.h[element, None] * np.einsum("km,kms->ks", basis, f[element])
