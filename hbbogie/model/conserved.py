"""Linear quantities that the equations of motion conserve."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hbbogie.model.stacked import at_each

if TYPE_CHECKING:
    from hbbogie.model.system import System
    from hbbogie.results import Orbit

Array = NDArray[np.float64]
REGULAR = 1e-9  # smallest singular value, relative to the largest, of a matrix without a null vector
ZERO = 1e-11  # share of the largest singular value of samples of the rates up to which one is zero


def conserved_quantities(system: System, p: Array, size: Array) -> Array:
    """Return rows w with w . x constant along every motion: the left null space of samples of the rates.

    Parameters
    ----------
    system : System
    p : ndarray, shape (number of parameters,)
    size : ndarray, shape (n_states,)
        Size of each state, in which the samples are taken.

    Returns
    -------
    ndarray, shape (k, n_states)
        Each with entries of at most 1, in echelon form.
    """
    return conserved_in_each(system, p[None], size[None])[0]


def conserved_in_each(system: System, p: Array, size: Array) -> list[Array]:
    """Return `conserved_quantities` at each of some parameter values, shape (P, ...), with sizes (P, n_states)."""
    none = np.zeros((0, system.n_states))
    regular = _regular(system, p, size)
    return [none if known else _conserved(system, *at) for known, *at in zip(regular, p, size, strict=True)]


def _conserved(system: System, p: Array, size: Array) -> Array:
    n = system.n_states
    samples = 2 * n + 6
    rates = system.once(("rates", samples), lambda: system.ode.map(samples))
    rng = np.random.default_rng(1995)
    x = np.where(size > 0, size, 1.0)[:, None] * rng.standard_normal((n, samples))
    for states in (x, np.abs(x)):  # many equations make sense for positive values only
        f = rates(states, np.tile(p[:, None], samples)).full()
        f = f[:, np.isfinite(f).all(axis=0)]
        if f.shape[1] > n:
            break
    else:
        return np.zeros((0, n))
    rows = np.abs(f).max(axis=1)
    rows = np.where(rows > 0, rows, 1.0)
    f = f / rows[:, None]
    columns = np.abs(f).max(axis=0)
    U, s, _ = np.linalg.svd(f / np.where(columns > 0, columns, 1.0))
    count = n - int((s > ZERO * max(float(s[0]), 1e-300)).sum())
    return echelon((U[:, n - count :] / rows[:, None]).T) if count else np.zeros((0, n))


def conserved_along(system: System, orbit: Orbit, p: Array) -> Array:
    """Return `conserved_quantities` with the states in the sizes that they have along an orbit."""
    size = np.abs(orbit.coefficients).sum(axis=0)
    return conserved_quantities(system, p, np.append(size, orbit.omega * size[list(system.second_order)]))


def _regular(system: System, p: Array, size: Array) -> NDArray[np.bool_]:
    """Tell whether the rates have a regular derivative at some state: what they conserve would be its left null."""
    n = size.shape[1]
    scale = np.where(size > 0, size, 1.0)
    A = at_each(system.once, system.ode_jacobian, scale * _somewhere(n), p) * scale[:, None]
    finite = np.isfinite(A).all(axis=(1, 2))
    A[~finite] = 0.0
    rows = np.abs(A).max(axis=2)
    s = np.linalg.svd(A / np.where(rows > 0, rows, 1.0)[:, :, None], compute_uv=False)
    return np.asarray(finite & (s[:, -1] > REGULAR * s[:, 0]))


@cache
def _somewhere(n: int) -> Array:
    return np.random.default_rng(1995).standard_normal(n)


def echelon(rows: Array) -> Array:
    """Return a basis of the same space with few entries, by elimination; the first entry of each is 1."""
    rows = rows.copy()
    for k in range(len(rows)):
        i, j = (int(x) for x in np.unravel_index(np.argmax(np.abs(rows[k:])), rows[k:].shape))
        rows[[k, k + i]] = rows[[k + i, k]]
        rows[k] /= rows[k, j]
        for other in range(len(rows)):
            if other != k:
                rows[other] -= rows[other, j] * rows[k]
        rows[np.abs(rows) < 1e-9] = 0.0
    lead = [row[np.flatnonzero(row)[0]] if np.any(row) else 1.0 for row in rows]
    return np.asarray(rows / np.array(lead)[:, None])


def expression(row: Array, names: tuple[str, ...]) -> str:
    """Return a linear combination of names as text."""
    terms = [f"{'' if abs(w - 1) < 1e-9 else f'{w:.6g} '}{name}" for w, name in zip(row, names, strict=True) if w]
    return " + ".join(terms).replace("+ -1 ", "- ").replace("+ -", "- ")


def state_names(system: System) -> tuple[str, ...]:
    """Return the names of the states: the coordinates, and with a prime the velocities of those of second order."""
    names, second = system.coordinate_names, system.second_order
    return (*names, *(f"{name}'" for name, s in zip(names, second, strict=True) if s))
