"""Whether the cycle at a fold is resolved: its multipliers tell."""

from __future__ import annotations

import numpy as np

from hbbogie.model.conserved import conserved_along
from hbbogie.model.system import System
from hbbogie.results import Orbit
from hbbogie.results.failure import FAILURES
from hbbogie.results.orbit import NOT_RESOLVED
from hbbogie.stability.multipliers import floquet

MEET = 0.1  # distance from 1 up to which the two multipliers that meet at a fold may be: the root of their error


def doubt_at_fold(system: System, orbit: Orbit) -> str:
    """Return why the cycle at a fold is not resolved, the end of a sentence; empty where it is.

    At a fold another multiplier meets the trivial one at 1 (of half a period for an odd cycle of an odd system). The
    equations of harmonic balance have folds of their own where their harmonics are too few, as in a canard: there the
    multipliers of the cycle are elsewhere.
    """
    try:
        s = floquet(system, orbit)
    except FAILURES:
        return ""
    m = s.multipliers if s.half_multipliers is None else s.half_multipliers
    held = len(conserved_along(system, orbit, system.vector(**orbit.parameters)))  # leave as many at 1 anyway
    place = 1 if s.half_multipliers is not None else 1 + held
    if len(m) <= place or not np.isfinite(m).all():
        return ""
    off = float(np.sort(np.abs(m - 1))[place])
    if off <= MEET:
        return ""
    return f"{NOT_RESOLVED}: two multipliers should meet at 1, and one is off by {off:.2g}; take more harmonics"
