"""Motions that decay to an equilibrium as slowly as its eigenvalues let them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hbbogie.branches.starts import Equilibrium
from hbbogie.deadline import time_is_over
from hbbogie.model.system import System
from hbbogie.motion.integration import states_after
from hbbogie.results.failure import ConvergenceError

Array = NDArray[np.float64]
TIMES, SAMPLES = 3, 40  # times of the slowest mode, its periods, over which a motion is followed, and samples of each
AT_LEAST = 0.5  # share of the slowest eigenvalue's decay that is asked of a motion
HALVINGS = 20  # of the distance from the equilibrium
LINEAR = 1e-3  # difference, relative to its size, of a motion and of twice the one from half the distance
TOLERANCE = 1e-10  # of the integration
DEFECTIVE = 1e8  # condition of the eigenvectors beyond which they are no coordinates


def decays(system: System, x: Array, equilibria: list[Equilibrium]) -> bool:
    """Tell whether the motion from a state decays to one of the equilibria, and no cycle lies between.

    In the coordinates of the modes the motions from the state, and from half its distance from the equilibrium, a
    quarter and so on, must come nearer in every period of the slowest mode, by at least half as much as that mode lets
    expect. The last two of them must be one motion in two sizes: there the system is linear, and its eigenvalues
    decide.
    """
    return any(_to(system, x, e) for e in equilibria if len(e.eigenvalues) and not e.unstable)


def _to(system: System, x: Array, e: Equilibrium) -> bool:
    slowest = complex(e.eigenvalues[0])
    if not slowest.real < -1e-9 * abs(slowest) or np.linalg.cond(e.vectors) > DEFECTIVE:
        return False
    time = 2 * np.pi / abs(slowest.imag) if slowest.imag else 1 / abs(slowest.real)
    modes, p = np.linalg.inv(e.vectors), system.vector()
    limit = np.exp(AT_LEAST * slowest.real * time)
    before, away = np.empty((0, 0), dtype=complex), x - e.x
    for k in range(HALVINGS):
        share = 0.5**k
        if time_is_over():
            return False
        after = [e.x + share * away]
        for _ in range(TIMES):
            try:
                after.extend(states_after(system, after[-1], p, time / SAMPLES, SAMPLES, TOLERANCE))
            except ConvergenceError:
                return False
            motion = (np.array(after) - e.x) @ modes.T / share
            distance = np.linalg.norm(motion[::SAMPLES], axis=1)
            if not np.isfinite(distance).all() or distance[-1] > limit * distance[-2]:
                return False
        if len(before) and np.abs(motion - before).max() <= LINEAR * np.abs(motion).max():
            return True
        before = motion
    return False
