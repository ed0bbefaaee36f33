"""Many coupled groups of bodies: cycles to which motions lead, where the branches from Hopf points are too many."""

from __future__ import annotations

from hbbogie.branches.census import Census
from hbbogie.equilibria.census import Start
from hbbogie.model.system import System
from hbbogie.motion.energy import sets_looked_at

SHARE = 0.2  # of the way from the first Hopf point to the beginning of the interval, at which motions begin


def census_below(
    system: System, parameter: str, interval: tuple[float, float], low: float, start: Start | None
) -> Census:
    """Return the cycles to which motions of the groups lead at a value below the first Hopf point.

    Parameters
    ----------
    system : System
    parameter : str
    interval : (float, float), unit of the parameter
        From where to the first Hopf point.
    low : float, unit of the parameter
        Where the critical values are looked for from.
    start : see `critical_speeds`
    """
    value = interval[1] - SHARE * (interval[1] - max(low, interval[0]))
    census = Census(system.with_parameters(**{parameter: value}), parameter, interval, start, False)
    census.simulate(random=False)
    census.look_in_groups()
    return census


def left_out(system: System, hopf: int, value: float, parameter: str) -> str:
    """Return what was not looked at, a sentence."""
    return (
        f"motions were begun {sets_looked_at(system)}; the branches from the {hopf} Hopf points, each of which has "
        f"many folds, and folds above {parameter} = {value:.6g} were not looked for"
    )
