"""Hysteresis: a parameter falls until oscillation dies out, and rises until a disturbance starts it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hbbogie.attraction.endings import place_of, steps_for
from hbbogie.branches.crossing import branches_from_hopf, crossings
from hbbogie.branches.judging import stability_of
from hbbogie.equilibria.hopf import hopf_points
from hbbogie.equilibria.linearisation import Linearisation
from hbbogie.errors import ModelError, door, positive
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.model.ranges import check_interval, default_reach
from hbbogie.model.system import System
from hbbogie.motion.integration import Initial, initial_state
from hbbogie.motion.slow_parameter import simulate_ramp, turning_points
from hbbogie.progress import Progress, silent
from hbbogie.results import Branch, Hysteresis, Orbit, Passage
from hbbogie.results.failure import ConvergenceError

Array = NDArray[np.float64]
HARMONICS = 31  # highest harmonic of the cycles
DISTURBANCE = 1e-2  # at the start of a rise, in units of the level
SAMPLES = 201  # samples of the linear growth rate over the range


@door(system=System, parameter=str)
def find_hysteresis(
    system: System,
    parameter: str,
    interval: tuple[float, float],
    rates: ArrayLike,
    *,
    coordinate: str | None = None,
    level: float | None = None,
    start: Mapping[str, float] | None = None,
    rise_from: float | None = None,
    branches: Sequence[Branch] | None = None,
    progress: Progress = silent,
) -> Hysteresis:
    """Let a parameter fall until an oscillation dies out, and rise until a disturbance starts the oscillation.

    Parameters
    ----------
    system : System
    parameter : str
    interval : (float, float), unit of the parameter
        The parameter falls from the upper end, where the motion begins on the largest stable cycle, to the lower end.
        It rises to the upper end.
    rates : array_like, shape (rates,), unit of the parameter per second
        Magnitudes of the rates, each for one fall and one rise.
    coordinate : str, optional
        The coordinate whose peaks are observed; by default the first nonlinear one.
    level : float, unit of the coordinate, optional
        The oscillation has *died out* where the peaks fall below this level for good, and has *started* where they
        first reach it. By default, the level is the gap that the coordinate has to cross before it meets a
        piecewise-linear element, so that it means contact. Without such an element it is half the peak of the cycle at
        the fold, or of the cycle at the upper end if there is no fold.
    start : mapping from name to value, unit of the coordinate (with a prime: per second), optional
        The disturbance of the equilibrium from which the rise begins. By default, the coordinate is displaced by a
        hundredth of the level.
    rise_from : float, unit of the parameter, optional
        Where the rise begins. By default, at the first Hopf point in the interval, or at the lower end if there is
        none.
    branches : sequence of Branch, optional
        The cycles over the parameter; by default they are traced from its Hopf points.
    progress : callable
        Called with (message, fraction done or None).

    Returns
    -------
    Hysteresis
        A motion that blows up gives a passage without peaks, whose status says why.

    Raises
    ------
    ModelError
        For invalid names or values, or if there is no stable cycle at the upper end.

    Notes
    -----
    The oscillation starts late for two reasons, which depend on the rate in different ways. First, growth takes time
    once the equilibrium is unstable. Second, the disturbance decays on the way to the Hopf point and has to grow back
    first. Linear growth reaches the level L from the disturbance a where the integral of sigma over the parameter is
    rate ln(L / a), with sigma the largest real part of the eigenvalues (eq-onset). If the rise begins before the Hopf
    point, this value does not tend to the Hopf point as the rate tends to zero. It tends to a value as far beyond the
    Hopf point, weighted with sigma, as the start lies before it. A real track disturbs all the time. A rise that begins
    at the Hopf point therefore avoids the decay.
    """
    lo, hi = check_interval(system, parameter, interval)
    speeds = np.sort(np.atleast_1d(np.asarray(rates, dtype=float)))[::-1]
    if speeds.ndim != 1 or not len(speeds) or not (np.isfinite(speeds).all() and (speeds > 0).all()):
        raise ModelError(f"rates: got {rates!r}; give finite numbers above 0, in units of {parameter} per second.")
    name = coordinate or (system.nonlinear_coordinates or system.coordinate_names)[0]
    i = system.index(name)
    equations = HarmonicBalance(HARMONICS).equations(system)
    if branches is None:
        progress("tracing the cycles", None)
        reach = default_reach(system.with_parameters(**{parameter: hi}), parameter)
        around = min(lo, reach[0]), max(hi, reach[1])  # a branch may begin or turn outside the interval
        branches = branches_from_hopf(equations, parameter, around)
    cycle, branch = _start_cycle(system, parameter, hi, branches, name)
    folds = [s for s in branch.folds() if s.value <= hi]
    fold = max(folds, key=lambda s: s.value, default=None)
    hopf = min((s.value for s in hopf_points(system, parameter, (lo, hi))), default=float("nan"))
    limit, meaning = (level, "as given") if level is not None else _level(system, name, fold.orbit if fold else cycle)
    limit = positive("level", limit, system.coordinates[i].unit or "1")
    bottom = rise_from if rise_from is not None else hopf if np.isfinite(hopf) else lo
    if not lo <= bottom < hi:
        raise ModelError(f"rise_from: got {bottom:g}; give a value of {parameter} from {lo:g} to below {hi:g}.")
    start_low, start_high = (system.with_parameters(**{parameter: v}) for v in (bottom, hi))
    begin = start or {name: DISTURBANCE * limit}
    rest = Linearisation(start_low, parameter).equilibrium(bottom)
    disturbed = {n: v + (rest[system.index(n)] if n in system.coordinate_names else 0.0) for n, v in begin.items()}
    kept = {n: float(v) for n, v in zip(system.coordinate_names, rest, strict=True)} | disturbed
    place = place_of(start_high, parameter, [cycle], [])
    step = cycle.period / steps_for(start_high, [(place, np.zeros(system.n_states))])
    passage = partial(_passage, parameter=parameter, step=step, name=name, rest=float(rest[i]), level=limit)
    falling, rising = [], []
    for k, rate in enumerate(speeds):
        progress(f"ramps: rate {rate:g}", k / len(speeds))
        foreseen = predicted_onset(
            start_low, begin, parameter=parameter, interval=(bottom, hi), rate=rate, name=name, level=limit
        )
        falling.append(passage(start_high, cycle, -rate, duration=(hi - lo) / rate))
        rising.append(passage(start_low, kept, rate, duration=(hi - bottom) / rate, predicted=foreseen))
    return Hysteresis(
        system=system.name,
        parameter=parameter,
        parameter_unit=system.parameter(parameter).unit,
        interval=(lo, hi),
        coordinate=name,
        unit=system.coordinates[i].unit,
        level=limit,
        meaning=meaning,
        falling=tuple(falling),
        rising=tuple(rising),
        fold=fold.value if fold else float("nan"),
        hopf=hopf,
        parameters={n: v for n, v in system.values.items() if n != parameter},
    )


def _start_cycle(
    system: System, parameter: str, value: float, branches: Sequence[Branch], name: str
) -> tuple[Orbit, Branch]:
    """Return the largest stable cycle at a value, and its branch."""
    equations = HarmonicBalance(HARMONICS).equations(system)
    found = [
        (o.replace(stability=stability_of(system, o)), b) for b in branches for o in crossings(equations, b, value)
    ]
    stable = [(o, b) for o, b in found if o.stability is not None and o.stability.verdict == "stable"]
    if not stable:
        raise ModelError(
            f"system {system.name!r} has no stable cycle at {parameter} = {value:g}, the upper end of the range, on a "
            "branch that begins at a Hopf point; give another range."
        )
    return max(stable, key=lambda pair: pair[0].amplitude(name))


def _level(system: System, name: str, cycle: Orbit) -> tuple[float, str]:
    """Return the level for a coordinate, and what it is."""
    gaps, zero, p = [], np.zeros(system.n), system.vector()
    for e in system.elements:
        if e.ramps is None:
            continue
        unit = np.eye(system.n)[system.index(name)]
        across = [float(e.argument(q, zero, p)) for q in (zero, unit, *(np.eye(system.n) - np.diag(unit)))]
        alone = across[1] - across[0] != 0 and all(u == across[0] for u in across[2:])
        thresholds = np.array(e.directions) * e.gaps(p)
        if alone:
            gaps.append(float(np.abs((thresholds - across[0]) / (across[1] - across[0])).min()))
    gaps = [gap for gap in gaps if np.isfinite(gap)]
    if gaps and max(gaps) > 0:
        return max(gaps), f"the gap, where contact of {name} ends and begins"
    return 0.5 * cycle.amplitude(name), "half the peak of the cycle at the fold, or of the first if there is no fold"


def _passage(
    system: System,
    initial: Initial,
    rate: float,
    *,
    parameter: str,
    duration: float,
    step: float,
    name: str,
    rest: float,
    level: float,
    predicted: float = float("nan"),
) -> Passage:
    """Follow a motion while the parameter changes from the system's value, and find where it crosses the level."""
    try:
        motion = simulate_ramp(system, initial, duration, parameter=parameter, rate=rate, step=step)
    except ConvergenceError as error:
        return Passage(
            rate=rate, values=np.empty(0), peaks=np.empty(0), event=float("nan"), predicted=predicted, status=str(error)
        )
    times, peaks = turning_points(motion, name, rest)
    values = system.values[parameter] + rate * times
    above = np.flatnonzero(peaks >= level)
    nowhere = Passage(rate=rate, values=values, peaks=peaks, event=float("nan"), predicted=predicted, status="")
    if rate < 0:
        if not len(above) or above[-1] == len(peaks) - 1:
            return replace(nowhere, status="has not died out before the end of the range")
        k, what = above[-1], "dies out"
    else:
        if not len(above) or above[0] == 0:
            return replace(nowhere, status="above the level from the beginning" if len(above) else "has not started")
        k, what = above[0] - 1, "starts"
    share = (level - peaks[k]) / (peaks[k + 1] - peaks[k])
    event = float(values[k] + share * (values[k + 1] - values[k]))
    return replace(nowhere, event=event, status=f"{what} at {parameter} = {event:.6g}")


def predicted_onset(
    system: System,
    start: Mapping[str, float],
    parameter: str,
    interval: tuple[float, float],
    rate: float,
    name: str,
    level: float,
) -> float:
    """Return where a disturbance of the equilibrium reaches a level by linear growth (eq-onset); NaN if it does not.

    Parameters
    ----------
    system : System
    start : mapping from name to value, unit of the coordinate (with a prime: per second)
        Relative to the equilibrium at the lower end of the interval, where the rise begins.
    parameter : str
    interval : (float, float), unit of the parameter
    rate : float, unit of the parameter per second
    name : str
        The coordinate observed.
    level : float, unit of the coordinate
    """
    line = Linearisation(system, parameter)
    values = np.linspace(*interval, SAMPLES)
    sigma = np.array([line.eigen(float(v))[0][0].real for v in values])
    eigenvalues, vectors = line.eigen(float(interval[0]))
    share = np.linalg.solve(vectors, initial_state(system, start)[1].astype(complex))[0]
    paired = 2.0 if abs(eigenvalues[0].imag) > 0 else 1.0
    amplitude = paired * abs(share * vectors[system.index(name), 0])
    if not 0 < amplitude < level:
        return float("nan")
    growth = np.r_[0.0, np.cumsum(0.5 * (sigma[1:] + sigma[:-1]) * np.diff(values))] - rate * np.log(level / amplitude)
    reached = np.flatnonzero(growth >= 0)
    if not len(reached):
        return float("nan")
    k = int(reached[0])
    return float(np.interp(0.0, growth[k - 1 : k + 1], values[k - 1 : k + 1]))
