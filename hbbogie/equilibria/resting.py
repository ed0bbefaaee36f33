"""The equilibrium near which a motion rests."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hbbogie.model.system import System
from hbbogie.results.failure import ConvergenceError

Array = NDArray[np.float64]
NEWTON = 50
CONVERGED = 1e-10  # size of a step at which Newton's method has converged, in units of the sizes


def resting_place(system: System, states: Array, p: Array, size: Array) -> Array | None:
    """Return the equilibrium to which Newton's method leads from the slowest of some states, shape (n_states,).

    Parameters
    ----------
    system : System
    states : ndarray, shape (K, n_states)
        Of the motion.
    p : ndarray, shape (number of parameters,)
    size : ndarray, shape (n_states,)
        Size of each state.

    Returns
    -------
    ndarray or None
        None where Newton's method does not converge.
    """
    rates = np.abs(system.ode(states.T, p).full().T / size).max(axis=1)
    x = states[np.argmin(rates)]
    try:
        for _ in range(NEWTON):
            A = system.state_matrix(x, p) * size  # singular where a quantity is conserved
            step = size * np.linalg.lstsq(A, system.ode(x, p).full().ravel(), rcond=1e-12)[0]
            x = x - step
            if np.abs(step / size).max() <= CONVERGED:
                return np.asarray(x)
    except (ConvergenceError, np.linalg.LinAlgError):
        return None
    return None


def at_rest(system: System, x: Array) -> str:
    """Return an equilibrium for people, such as ``the equilibrium x = 0``."""
    shown = [
        f"{name} = {v if abs(v) > 1e-15 else 0.0:.6g}" for name, v in zip(system.coordinate_names, x, strict=False)
    ]
    return f"the equilibrium {', '.join(shown[:4])}{', ...' if len(shown) > 4 else ''}"
