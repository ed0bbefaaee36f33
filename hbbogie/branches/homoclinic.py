"""Branches of harmonic balance that run into a homoclinic motion, which no number of harmonics resolves."""

from __future__ import annotations

import numpy as np

from hbbogie import fourier
from hbbogie.equilibria.resting import at_rest, resting_place
from hbbogie.model.system import System
from hbbogie.model.turns import turns_of
from hbbogie.results import Orbit
from hbbogie.results.ending import Ending

UNRESOLVED = 1e-2  # share of the highest harmonics from which cycles are no longer resolved
MEETS = 1e-2  # distance from an equilibrium, relative to the range, of a cycle that meets it
HITS = 1e-3  # the same of a cycle that harmonics resolve
NEAR, RESTING = 0.1, 0.4  # distance within which a cycle rests there, and share of its period that it spends so
ADVICE = "follow it from one of its cycles by collocation: trace(Collocation().equations(system), ...)"


def homoclinic_ending(system: System, orbit: Orbit, where: str) -> Ending | None:
    """Return the ending of a branch whose cycle rests at an equilibrium; None otherwise.

    Parameters
    ----------
    system : System
    orbit : Orbit
    where : str
        The value of the parameter, for people.
    """
    tau = fourier.phases(16 * (orbit.H + 1))
    q, v = orbit.at(tau), orbit.omega * orbit.at(tau, 1)
    states = np.hstack([q, v[:, list(system.second_order)]])
    size = np.ptp(states, axis=0)
    size = np.maximum(size, 1e-9 * size.max())
    slow = np.abs(states / size)[:, system.n :] <= NEAR
    if slow.all(axis=1).mean() < RESTING:  # at rest velocities are none
        return None
    with np.errstate(all="ignore"):
        x = resting_place(system, states, system.vector(**orbit.parameters), size)
    if x is None:
        return None
    off = states - x
    if orbit.advance:  # an angle rests there a turn further, too
        turns = np.append(turns_of(system.dynamics), np.zeros(system.n_states - system.n))
        off -= turns * np.round(off / np.where(turns, turns, np.inf))
    far = np.abs(off / size).max(axis=1)
    odd = not orbit.advance and fourier.is_odd(orbit.coefficients)
    other = np.abs((states + x) / size).max(axis=1) if odd else far
    if far.min() > (HITS if orbit.tail < UNRESOLVED else MEETS) or (np.minimum(far, other) <= NEAR).mean() < RESTING:
        return None
    kind = "heteroclinic" if other is not far and np.abs(x / size).max() > NEAR else "homoclinic"
    smooth = not any(element.ramps is not None or element.heights is not None for element in system.elements)
    what = f"{kind} approach near {where}, at {at_rest(system, x)}; the period is {orbit.period:.4g} s"
    return Ending("homoclinic", what, ADVICE if smooth else "")
