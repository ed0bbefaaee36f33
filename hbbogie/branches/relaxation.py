"""Cycles that harmonics do not resolve, such as those of relaxation, by collocation: the census's last resort."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hbbogie.collocation.cycle import CollocatedCycle
from hbbogie.collocation.solving import MOST, Guess, collocated
from hbbogie.collocation.starting import Sampled, from_motion
from hbbogie.model.system import System
from hbbogie.results.failure import FAILURES

Array = NDArray[np.float64]
LIKE = 0.03  # distance of frequency, means and extremes, relative to the ranges, up to which a motion is on a cycle


def settled(system: System, x: Array, *, backwards: bool = False) -> Sampled | None:
    """Return the last period of the motion from a state; None where it does not repeat itself in some thousand steps.

    Parameters
    ----------
    system : System
    x : ndarray, shape (n_states,)
    backwards : bool
        Whether the motion, and the state, are those backwards in time.
    """
    if _kinked(system):
        return None
    try:
        met = from_motion(system.backwards() if backwards else system, x)
    except FAILURES:
        return None
    return met.backwards(system) if backwards else met


def _kinked(system: System) -> bool:
    """Tell whether elements are piecewise linear: the exact method and shooting then serve better."""
    return any(element.ramps is not None for element in system.elements)


def solved(
    system: System, guess: Guess, *, kinked: bool = False, most: int = MOST, waveform: float = np.inf
) -> CollocatedCycle | None:
    """Return the cycle that collocation leads to from a guess; None where there is none with so many intervals.

    Systems with piecewise-linear elements are tried only if ``kinked`` says so. Of a waveform whose estimated error is
    larger than asked for the intervals are divided.
    """
    if _kinked(system) and not kinked:
        return None
    try:
        cycle = collocated(system, guess, most=most)
        while cycle.waveform_error > waveform and len(cycle.mesh) <= most // 2:
            cycle = collocated(system, cycle, intervals=2 * (len(cycle.mesh) - 1))
    except FAILURES:
        return None
    return cycle


def on_one_of(motion: Sampled, marks: list[Array]) -> bool:
    """Tell whether a motion is on one of some cycles, by their frequencies, means and extremes."""
    mark = motion.mark()
    _, low, high = mark[1:].reshape(3, -1)
    width = np.tile(np.maximum(high - low, 1e-6 * float((high - low).max())), 3)
    return any(abs(mark[0] / k[0] - 1) < LIKE and (np.abs(mark - k)[1:] < LIKE * width).all() for k in marks)
