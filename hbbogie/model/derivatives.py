"""Derivatives at points where equations have none, but the same one on all sides, as beside a root at zero."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np

from hbbogie.results.failure import ConvergenceError

ASIDE = 1e-12  # distance at which a derivative that does not exist at a point is looked at
AGREEING = 1e-6  # relative difference up to which derivatives on both sides are the same


def beside(at: Callable[[Any], Any], x: Any, J: Any) -> Any:
    """Return derivatives J = at(x) at many points, those not finite replaced by ones beside, where all sides agree."""
    lost = ~np.isfinite(J).all(axis=(1, 2))
    if not lost.any():
        return J
    aside = ASIDE * np.cos(np.arange(1.0, 1 + x.shape[1])) * np.maximum(np.abs(x), 1.0)
    sides = [at(x + f * aside) for f in (1.0, -1.0, 10.0)]
    size = np.abs(sides[0]).max(axis=(1, 2))
    same = [np.abs(s - sides[0]).max(axis=(1, 2)) <= AGREEING * size for s in sides[1:]]
    return np.where((lost & same[0] & same[1])[:, None, None], sides[0], J)


def state_matrix_at(name: str, jacobian: ca.Function, x: Any, p: Any) -> Any:
    """Return the state matrix of a system at a state (see `System.state_matrix`)."""

    def at(states: Any) -> Any:
        return np.array([jacobian(state, p).full() for state in states])

    (A,) = beside(at, x[None], at(x[None]))
    if not np.isfinite(A).all():
        rows = ", ".join(str(i + 1) for i in np.flatnonzero(~np.isfinite(A).all(axis=1)))
        raise ConvergenceError(
            f"system {name!r}: the rates of states {rows} have no derivative at {x}; look for a root, a "
            "division or a logarithm there, or begin at another state."
        )
    return A
