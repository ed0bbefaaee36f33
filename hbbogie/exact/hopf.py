"""Hopf points of many designs at once, with gradients in all parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hbbogie.exact.model import SwitchedLinear

Array = NDArray[np.float64]

ITERATIONS = 20
LARGEST = 0.3  # largest change of the parameter in one step, relative to its value
SQUARINGS, SMALL = 12, 0.5  # how often powers are squared, and the norm below which they have become small
BELOW = 16  # values below a Hopf point at which the stability of the equilibrium is checked


@dataclass(frozen=True, eq=False)
class HopfPoints:
    """The Hopf points of B designs at which the equilibrium loses its stability as the parameter rises.

    Attributes
    ----------
    value : ndarray, shape (B,), unit of the parameter
        NaN where none was found.
    omega : ndarray, shape (B,), rad/s
    gradient : ndarray, shape (B, number of parameters)
        Derivative of the value in all parameters; -1 in the parameter itself.
    first : ndarray of bool, shape (B,)
        Whether the equilibrium is stable at all values checked from the lower end up to the point.
    mode : ndarray of complex, shape (B, n)
        The critical eigenvector.
    """

    value: Array
    omega: Array
    gradient: Array
    first: NDArray[np.bool_]
    mode: NDArray[np.complex128]


def hopf_of(model: SwitchedLinear, p: Array, place: int, sides: Array, low: float) -> HopfPoints:
    """Find the Hopf point of each design by Newton's method on the real part of the rightmost oscillating mode.

    Parameters
    ----------
    model : SwitchedLinear
    p : ndarray, shape (B, number of parameters)
        The column of the parameter itself holds a first guess.
    place : int
        The parameter.
    sides : ndarray, shape (K,)
        Contact state at rest.
    low : float, unit of the parameter
        Lower end of the values checked.
    """
    p, B, n = p.copy(), len(p), model.N - 1
    every, rest, sides = np.arange(B), sides, np.broadcast_to(sides, (len(p), len(sides)))
    value, mode = np.full(B, np.nan), np.full((B, n), np.nan, dtype=complex)
    omega, weights = np.full(B, np.nan), np.zeros((B, n, n))
    for _ in range(ITERATIONS):
        A, _, dA, _ = model.with_slopes(sides[: len(every)], p[every], place)
        A, dA = A[:, :n, :n], dA[:, :n, :n]
        values, vectors = np.linalg.eig(A)
        growth = np.where(values.imag > 1e-9 * np.abs(values).max(axis=1, keepdims=True), values.real, -np.inf)
        k, rows = growth.argmax(axis=1), np.arange(len(every))
        left = np.linalg.solve(vectors.swapaxes(-1, -2), np.eye(n)[k][..., None].astype(complex))[..., 0]
        u = vectors[rows, :, k]
        slope = np.einsum("bi,bij,bj->b", left, dA, u).real
        real = growth[rows, k]
        done = np.abs(real) <= 1e-12 * np.abs(values[rows, k])
        step = np.clip(-real / slope / p[every, place], -LARGEST, LARGEST)
        at = every[done]
        value[at], omega[at], mode[at] = p[at, place], values[rows, k].imag[done], u[done]
        weights[at] = (left[:, :, None] * u[:, None, :]).real[done]
        keep = ~done & np.isfinite(step)
        # one more step costs less than chasing a tolerance below round-off
        p[every[keep], place] *= 1 + step[keep]
        tiny = keep & (np.abs(step) <= 1e-14)
        at = every[tiny]
        value[at], omega[at], mode[at] = p[at, place], values[rows, k].imag[tiny], u[tiny]
        weights[at] = (left[:, :, None] * u[:, None, :]).real[tiny]
        every = every[keep & ~tiny]
        if not len(every):
            break
    found = np.isfinite(value)
    gradient = np.full(p.shape, np.nan)
    if found.any():
        full = np.zeros((int(found.sum()), n + 1, n + 1))
        full[:, :n, :n] = weights[found]
        rows_ = np.zeros((len(full), len(model.surfaces), n + 1))
        slopes = model.pulled_back(sides[: len(full)], p[found], full, rows_)
        gradient[found] = -slopes / slopes[:, [place]]
    return HopfPoints(value, omega, gradient, found & _stable_below(model, p, place, rest, low, found), mode)


def unstable_at(model: SwitchedLinear, p: Array, place: int, sides: Array, values: Array) -> NDArray[np.int_]:
    """Return how many eigenvalues of the equilibrium are not stable at some values, shape (B, number of values).

    Parameters
    ----------
    model, p, place, sides
        As for `hopf_of`.
    values : ndarray, shape (B, number of values), unit of the parameter
    """
    A = _at_rest(model, p, place, sides, values)
    return np.asarray((np.linalg.eigvals(A).real >= 0).sum(axis=1).reshape(values.shape))


def _at_rest(model: SwitchedLinear, p: Array, place: int, sides: Array, values: Array) -> Array:
    """Return the state matrices at some values of the parameter of each design, shape (B * values of each, n, n)."""
    n, q = model.N - 1, np.repeat(p, values.shape[1], axis=0)
    q[:, place] = values.ravel()
    return model.matrices(np.broadcast_to(sides, (len(q), len(sides))), q)[0][:, :n, :n]


def _stable_below(
    model: SwitchedLinear, p: Array, place: int, sides: Array, low: float, found: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Return whether all eigenvalues have negative real parts at some values between the lower end and each point."""
    shares = (np.arange(BELOW) + 0.5) / BELOW
    stable, value = np.zeros(len(p), dtype=bool), p[found, place, None]
    A = _at_rest(model, p[found], place, sides, low + (value - low) * shares)
    stable[found] = _stable(A).reshape(-1, BELOW).all(axis=1)
    return stable


def _stable(A: Array) -> NDArray[np.bool_]:
    """Return of which matrices, shape (M, n, n), all eigenvalues have negative real parts.

    They do if powers of (c + A) / (c - A) = 2 c / (c - A) - 1, c > 0, become small: its eigenvalues are inside the unit
    circle then. This takes a third of the time of the eigenvalues, which decide where powers do not become small.
    """
    eye, c = np.eye(A.shape[-1]), np.einsum("mij,mji->m", A, A)
    c = np.sqrt(np.where(np.abs(c) > 0, np.abs(c), 1.0) / A.shape[-1])[:, None, None]
    try:
        power = 2 * c * np.linalg.inv(c * eye - A) - eye
    except np.linalg.LinAlgError:  # c is an eigenvalue somewhere
        power = np.tile(eye, (len(A), 1, 1))
    with np.errstate(all="ignore"):
        for _ in range(SQUARINGS):
            power = power @ power
        stable = np.linalg.norm(power, axis=(1, 2)) < SMALL
    stable[~stable] = (np.linalg.eigvals(A[~stable]).real < 0).all(axis=1)
    return np.asarray(stable)
