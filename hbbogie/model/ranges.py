"""Intervals of a parameter: checks of given ones, and defaults."""

from __future__ import annotations

from hbbogie.errors import ModelError, pair
from hbbogie.model.singular import ROOM, poles, without_poles
from hbbogie.model.system import System

BEYOND = 0.5  # share of the interval by which Hopf points are looked for beyond its ends


def default_reach(system: System, parameter: str) -> tuple[float, float]:
    """Return twice the value of a parameter (at least 1) to either side, within its bounds and up to the next pole.

    Raises
    ------
    ModelError
        Where the value itself is a pole of the equations.
    """
    (low, high), value = system.parameter(parameter).bounds, system.values[parameter]
    reach = max(2 * abs(value), 1.0)
    return without_poles(system, parameter, (max(value - reach, low), min(value + reach, high)))


def check_interval(system: System, parameter: str, interval: tuple[float, float] | None) -> tuple[float, float]:
    """Return the interval cut to the parameter's bounds, the default one for None.

    Raises
    ------
    ModelError
        When it is no pair of numbers (low, high), or nothing is left of it within the bounds.
    """
    low, high = system.parameter(parameter).bounds
    if interval is None:
        return default_reach(system, parameter)
    first, last = pair(f"interval of {parameter!r}", interval)
    lo, hi = max(first, low), min(last, high)
    if not lo < hi:
        raise ModelError(
            f"interval of {parameter!r}: got ({first:g}, {last:g}); give (low, high) with low < high, "
            f"within the parameter's bounds ({low:g}, {high:g})."
        )
    return lo, hi


def widened(system: System, parameter: str, interval: tuple[float, float]) -> tuple[float, float]:
    """Return an interval with half its width added at either end, within bounds and not over a pole outside."""
    low, high = interval
    more = BEYOND * (high - low)
    reach = check_interval(system, parameter, (low - more, high + more))
    room = ROOM * (high - low)
    found = poles(system, parameter, reach)
    below, above = ([pole for pole in found if beyond(pole)] for beyond in (lambda v: v <= low, lambda v: v >= high))
    return max([reach[0], *(v + room for v in below)]), min([reach[1], *(v - room for v in above)])


def check_start(parameter: str, value: float, interval: tuple[float, float]) -> None:
    """Raise `ModelError` where the start of a branch lies outside the interval over which it is to be followed."""
    low, high = interval
    if not low <= value <= high:
        raise ModelError(
            f"trace: the start has {parameter} = {value:g}, outside the interval ({low:g}, {high:g}); widen it."
        )
