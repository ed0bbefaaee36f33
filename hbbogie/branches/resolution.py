"""Whether the cycle at a fold is resolved: its multipliers tell."""

from __future__ import annotations

import numpy as np

from hbbogie.model.conserved import conserved_along
from hbbogie.model.system import System
from hbbogie.results import Orbit
from hbbogie.results.failure import FAILURES
from hbbogie.results.orbit import NOT_RESOLVED
from hbbogie.stability.multipliers import floquet_of_each

MEET = 0.1  # distance from 1 up to which the two multipliers that meet at a fold may be: the root of their error
EVEN = 0.3  # distance of their mean from 1, relative to their own, up to which they have parted from 1, to either side


def doubt_at_fold(system: System, orbit: Orbit) -> str:
    """Return why the cycle at a fold is not resolved, the end of a sentence; empty where nothing says so."""
    return meeting(system, orbit)[0]


def meeting(system: System, orbit: Orbit) -> tuple[str, bool]:
    """Return why the cycle at a fold is not resolved, empty where nothing says so, and whether that is sure.

    At a fold another multiplier meets the trivial one at 1 (of half a period for an odd cycle of an odd system). The
    equations of harmonic balance have folds of their own where their harmonics are too few, as in a canard: there the
    multipliers of the cycle are elsewhere. Those of slow modes are near 1, too, so that it is sure only where two are
    and have parted to both sides of it.
    """
    try:
        s = floquet_of_each(system, [orbit], level=False)[0]  # its verdict does not count
    except FAILURES:
        return "", False
    m = s.multipliers if s.half_multipliers is None else s.half_multipliers
    held = len(conserved_along(system, orbit, system.vector(**orbit.parameters)))  # leave as many at 1 anyway
    place = 1 if s.half_multipliers is not None else 1 + held
    if len(m) <= place or not np.isfinite(m).all():
        return "", False
    nearest = m[np.argsort(np.abs(m - 1))]
    off = np.abs(nearest - 1)
    if off[place] > MEET:
        many = f"two multipliers should meet at 1, and one is off by {off[place]:.2g}"
        return f"{NOT_RESOLVED}: {many}; take more harmonics", True
    alone = len(m) == place + 1 or off[place + 1] > MEET
    apart = abs(nearest[place - 1 : place + 1].mean() - 1) <= EVEN * off[place]
    return "", bool(alone and apart)
