"""Cycles of continuous families, as where something is conserved: the verdict among motions of one level."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hbbogie.model.system import System
from hbbogie.results import Orbit, Stability
from hbbogie.results.failure import FAILURES
from hbbogie.stability.verdicts import MARGIN, NEUTRAL
from hbbogie.stability.verification import verify

ONE = 1e-3  # distance from 1 of multipliers that are 1: where two meet they err by the root of the orbit's error
BESIDE = 1.03  # size of a guess of another member, relative to a cycle
MOVED = 1e-4  # least difference in size of the member found; a fold is met to the root of what is tolerated

ASIDE = 1e-3  # change of the parameters with which a family that is there by coincidence is none


def within_level(system: System, orbit: Orbit, found: Stability, held: int) -> Stability:
    """Return the verdict on a cycle of a family among motions of its level; as found where that cannot be told.

    It can where one multiplier is 1 besides the trivial one and those of the linear quantities, all others, of which
    there are some, are inside the unit circle, and another cycle is found beside this one which is not isolated either.
    That is looked for at parameters a thousandth away: cycles of one parameter value only form a family where something
    bifurcates, as at the Hopf point of a linear system.

    Parameters
    ----------
    system : System
    orbit : Orbit
    found : Stability
        Of the orbit.
    held : int
        Number of linear quantities that are conserved.
    """
    if not may_be_member(found, held) or not _has_another(system, orbit):
        return found
    others = np.abs(found.multipliers[np.abs(found.multipliers - 1) > ONE])
    reason = (
        f"the cycle is one of a family, as where something is conserved: {2 + held} multipliers at 1 are expected, and "
        f"found. Judged among motions of one level: all others inside the unit circle, the largest {others.max():.6g}"
    )
    return replace(
        found, verdict="stable", reason=reason + found.reason[found.reason.index("; error of the trivial") :]
    )


def may_be_member(found: Stability, held: int) -> bool:
    """Tell whether the multipliers are those of a cycle of a family, or of a fold."""
    off = np.abs(found.multipliers - 1)
    ones = off <= ONE
    others = np.abs(found.multipliers[~ones])
    if NEUTRAL not in found.reason or np.count_nonzero(ones) != 2 + held or not len(others):
        return False
    return bool(others.max() < 1 - MARGIN * off[ones].max())


def _has_another(system: System, orbit: Orbit) -> bool:
    """Tell whether shooting finds another cycle of a family, a little larger or, running on, faster."""
    c = orbit.coefficients.copy()
    c[1:] *= BESIDE
    guess = orbit.replace(omega=BESIDE * orbit.omega) if orbit.advance else orbit.replace(coefficients=c)
    shares = np.random.default_rng(1995).uniform(0.5, 1, len(orbit.parameters)) * ASIDE
    aside = {name: value * (1 + by) for (name, value), by in zip(orbit.parameters.items(), shares, strict=True)}
    try:
        there = verify(system, guess.replace(parameters=aside))
    except FAILURES:
        return False
    size, own = (np.linalg.norm(o.coefficients[1:]) for o in (there.orbit, orbit))
    grown = there.orbit.omega / orbit.omega if orbit.advance else size / own
    return not there.isolated and abs(float(grown) - 1) >= MOVED
