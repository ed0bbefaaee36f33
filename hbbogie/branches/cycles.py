"""All cycles at one parameter value, without a guess."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from hbbogie import fourier
from hbbogie.branches.census import EXACT, Census
from hbbogie.branches.choice import chosen_methods, equations_of
from hbbogie.branches.crossing import family_message
from hbbogie.branches.judging import verified
from hbbogie.branches.relaxation import solved
from hbbogie.branches.same import once_each
from hbbogie.branches.simulated import NEAR, settled_cycles
from hbbogie.collocation.cycle import cycle_again
from hbbogie.collocation.starting import from_orbit
from hbbogie.deadline import time_is_over, time_limit
from hbbogie.equilibria.census import Start
from hbbogie.errors import ModelError, door, positive, whole
from hbbogie.methods.equations import Equations
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.methods.size import has_many_states
from hbbogie.model.ranges import check_interval
from hbbogie.model.system import System
from hbbogie.results import Cycles, Orbit
from hbbogie.results.failure import FAILURES, ConvergenceError
from hbbogie.solving.linear import scaled, singularity
from hbbogie.solving.newton import Conditions, Problem
from hbbogie.solving.solvers import solve
from hbbogie.stability.multipliers import floquet

Array = NDArray[np.float64]
LATE = "the time limit was reached"
ORDERS = (15, 31, 63, 127)  # highest harmonics tried in turn
REFINED = 1e-6  # distance of the frequencies of a cycle and of itself on a better mesh
MOST = 63  # harmonics beyond which collocation is taken
POLISHED = "multiple shooting"  # the method of cycles whose harmonics are then chosen


@door(system=System, parameter=str)
def find_cycles(
    system: System,
    *,
    parameter: str | None = None,
    interval: tuple[float, float] | None = None,
    method: str = "auto",
    harmonics: int | str = "auto",
    tolerance: float = 1e-3,
    stability: bool = True,
    start: Start | None = None,
    backwards: bool | None = None,
    limit: float | None = None,
    **values: float,
) -> Cycles:
    """Find the cycles at given parameter values, by growing amplitude; no guess is needed.

    A census: all equilibria over an interval of one parameter and half of it beyond (see `find_equilibria`), the branch
    from every Hopf point on them, motions simulated from beside the equilibria and from random states, and the branches
    of the cycles that these come to, around their folds. Each candidate is polished by shooting, and what is returned
    is the polished cycle with its own multipliers; two candidates that lead to one cycle are one. A cycle on a branch
    that no Hopf point in reach leads to, and none of the motions, is not found: ``evidence`` says what was looked at.

    Parameters
    ----------
    system : System
    parameter : str, optional
        The parameter along which branches are traced; by default the first one given in ``values``, else
        the system's first.
    interval : (float, float), optional, unit of the parameter
        Where to look for Hopf points; by default twice the value (at least 1) to either side, within the
        parameter's bounds.
    method : {"auto", "exact", "mhb", "collocation"}
        How the cycles that are given are computed; the search is the same. "auto" gives them in closed form where the
        system is linear between switchings; else polished by shooting, as harmonics where up to 63 meet the tolerance,
        and by collocation where they do not. The status of each says which and why. "mhb" gives those of
        multi-harmonic balance next to the ones found.
    harmonics : int or "auto"
        Highest harmonic of "mhb". "auto" takes 15, 31, 63 or 127, the first that meets the tolerance. With a number
        method "auto" is "mhb".
    tolerance : float
        Largest error of the waveform, relative to the peak, with which harmonics are enough.
    stability : bool
        Whether the cycles have their Floquet multipliers and the verdict.
    start : Orbit, Trajectory, mapping from name to value or sequence of float, optional
        A state: only the equilibrium near it, and the motion from it, are looked at.
    backwards : bool, optional
        Whether motions are simulated backwards in time as well, where they settle on cycles that repel from all sides;
        by default where the system has two states.
    limit : float, optional, s
        Time after which the search ends with the cycles found, which is not ``complete``.
    **values : float
        Parameter values, by name.

    Returns
    -------
    Cycles : list of Orbit
        Empty where no cycle was found. The list carries ``evidence``: equilibria with their eigenvalues, Hopf points,
        branches and why each ended, motions and what they came to, what stayed undecided. ``complete`` says whether
        nothing cut the search short: no limit of time, no branch that could not be followed to its end, and, where no
        cycle was found, no motion of which it stays undecided whether it settles on one; ``undecided`` says what did.

    Raises
    ------
    ModelError
        For wrong names or values, a method that does not apply to the system, or when the cycles at this value form a
        continuous family.
    ConvergenceError
        When none of the cycles found is resolved by the number of harmonics asked for.

    Examples
    --------
    The period of van der Pol's oscillator at mu = 1 is 6.663287.

    >>> from hbbogie import load_problem
    >>> (cycle,) = find_cycles(load_problem("van_der_pol").van_der_pol(), mu=1.0)
    >>> round(cycle.period, 3), cycle.stability.verdict
    (6.663, 'stable')
    """
    system = system.with_parameters(**values)
    name = next(iter([*values, *system.parameter_names]), None) if parameter is None else parameter
    if name is None:
        raise ModelError(f"system {system.name!r} has no parameter to vary; give it one.")
    if not isinstance(harmonics, str) or harmonics != "auto":
        harmonics = whole("find_cycles: harmonics (a number or 'auto')", harmonics)
    tolerance = positive("tolerance", tolerance, "1")
    if harmonics != "auto":
        HarmonicBalance(int(harmonics)).check(system)
    methods = chosen_methods("find_cycles", system, method, None if harmonics == "auto" else harmonics)
    name = system.parameter(name).name
    interval = check_interval(system, name, interval)
    with time_limit(limit):
        census = Census(system, name, interval, start, system.n_states == 2 if backwards is None else backwards)
        looks = [census.follow_branches, census.simulate, census.look_in_groups]
        if has_many_states(system) and start is None:  # branches take long, and there are many
            groups, random = partial(census.simulate, random=False), partial(census.simulate, random=True)
            looks = [groups, census.look_in_groups, random, census.follow_branches]
        elif has_many_states(system):
            looks = [*looks[1:], looks[0]]
        for look in (*looks, census.follow_cycles):
            look()
        found, undecided, family = census.found, "", census.polishing.family
        if family and not found:
            raise ModelError(family)
        if family:
            census.evidence.append("a candidate is not isolated: it is one of a continuous family, or a fold is near")
        if not found and census.undecided[False] and not census.running and not time_is_over():
            found, undecided = _longer(census)
        late = [f"the time limit of {limit:g} s was reached" if limit else LATE] if time_is_over() else []
        if undecided and not late:
            census.evidence.insert(0, undecided)
            census.open.insert(0, undecided)
        elif not found and not late:
            census.say_none()
        if harmonics == "auto" and method.strip().casefold() == "auto":
            judged = [_best(system, orbit, tolerance) for orbit in once_each(found)]
        else:
            orders = ORDERS if harmonics == "auto" else (int(harmonics),)
            judged = _by(methods[0], census, once_each(found), orders, tolerance)
    judged = once_each(o if stability else o.replace(stability=None) for o in judged)
    return Cycles(judged, [*late, *census.evidence], [*late, *census.open])


def _longer(census: Census) -> tuple[list[Orbit], str]:
    """Let motions settle for as long as it takes, forwards and backwards in time; return cycles and what is open."""
    system, name = census.system, census.parameter
    for H in ORDERS:
        try:
            settled = settled_cycles(HarmonicBalance(H).equations(system), name)
        except ConvergenceError as error:
            if error.statistics.get("unresolved", True) and ORDERS[-1] != H:
                continue
            if error.orbit is not None and (polished := census.polishing.polished(error.orbit)) is not None:
                return [polished], ""
            return [], str(error)
        for cycle in settled:
            if not _isolated(HarmonicBalance(H).equations(system), cycle):
                raise ModelError(family_message(system, name, cycle))
        for cycle in settled:
            census.consider(cycle, "a motion that settles")
        census.evidence.append(f"motions of up to the longest time settle on {len(settled)} cycle(s)")
        return census.found, ""
    return [], ""


def _by(method: str, census: Census, found: list[Orbit], orders: tuple[int, ...], tolerance: float) -> list[Orbit]:
    """Return the cycles of a method next to those found; of harmonic balance with the first order that is enough."""
    kept, failed = list[Orbit](), None
    for orbit in found:
        if method != "mhb" and orbit.method.startswith(method):
            kept.append(orbit)
            continue
        for H in orders if method == "mhb" else orders[:1]:
            try:
                near = _near(method, census.system, orbit, H)
            except FAILURES as error:
                failed = f"{_what(method, H)} the cycle of period {orbit.period:.6g} s: {error}"
                continue
            if orders[-1] == H or (near.errors or {}).get("waveform", np.inf) <= tolerance or method != "mhb":
                kept.append(near)
                break
        else:
            census.evidence.append(str(failed))
    if failed and not kept:
        raise ConvergenceError(failed, orbit=found[-1])
    return kept


def _what(method: str, H: int) -> str:
    """Return what a method fails to do, the beginning of a sentence."""
    if method != "mhb":
        return f"the method {method!r} does not lead to"
    return f"harmonics up to {H} (ask for more with harmonics=...) do not resolve"


def _near(method: str, system: System, orbit: Orbit, H: int) -> Orbit:
    """Return the cycle of a method next to one found, with error estimates and the verdict on itself."""
    equations = equations_of(method, system, H)
    near = solve(equations, orbit, method="newton") if isinstance(equations, Equations) else equations.solve(orbit)
    if abs(near.omega / orbit.omega - 1) > NEAR:
        raise ConvergenceError(f"it leads to another period, {near.period:.6g} s", orbit=near)
    if method == "exact":
        peaks = {c: EXACT * near.amplitude(c) for c in near.coordinates}
        return near.replace(errors={"omega": EXACT * near.omega, "waveform": EXACT, **peaks})
    return _judged(system, near) if method == "mhb" else near


def _judged(system: System, orbit: Orbit) -> Orbit:
    """Return the orbit with error estimates and the verdict on itself, whatever its errors."""
    return verified(system, orbit)[0].replace(stability=floquet(system, orbit))


def _why(orbit: Orbit, tolerance: float) -> str:
    """Return why a cycle is given by the method that found it, a sentence."""
    if orbit.method == "exact":
        return " Taken since the system is linear between switchings."
    if not orbit.method.startswith("collocation"):
        return ""
    tau, H = orbit.motion.phases(), ORDERS[0]
    q, series = orbit.motion.at(tau), fourier.synthesis(H, tau) @ orbit.harmonics(H)
    error = float((np.abs(q - series).max(axis=0) / np.maximum(np.abs(q).max(axis=0), 1e-12 * np.abs(q).max())).max())
    if error > tolerance:
        return f" Taken since {H} harmonics leave an error of {error:.1e}, more than {tolerance:.0e}."
    return " Taken since shooting does not close the cycle."


def _best(system: System, orbit: Orbit, tolerance: float) -> Orbit:
    """Return a cycle found, polished by shooting, with as many harmonics as the tolerance takes, or by collocation."""
    if orbit.method.startswith("collocation"):  # from a branch, whose mesh may be that of a point before
        again = solved(system, cycle_again(system, orbit), kinked=True, waveform=tolerance)
        orbit = again.orbit() if again and abs(again.omega / orbit.omega - 1) < REFINED else orbit
    if not orbit.method.startswith(POLISHED):
        return orbit.replace(status=f"{orbit.status.rstrip('.')}.{_why(orbit, tolerance)}")
    waves = np.hypot(orbit.coefficients[1::2], orbit.coefficients[2::2])
    peaks = np.maximum(np.abs(orbit.extremes).max(axis=0), np.abs(orbit.advance or 0.0))
    size = np.maximum(peaks, np.finfo(float).tiny)
    moving = size > 1e-12 * size.max()

    def left(H: int) -> float:  # no less than the largest distance
        return float((waves[H:].sum(axis=0) / size)[moving].max())

    H = next((H for H in ORDERS if H >= orbit.H or left(H) <= tolerance), orbit.H)
    error = left(H) if orbit.H > H else max(orbit.tail, (orbit.errors or {})["waveform"])
    if H > MOST and (cycle := solved(system, from_orbit(system, orbit), kinked=True)) is not None:
        why = f"Taken since {MOST} harmonics leave an error of {left(MOST):.1e}, more than {tolerance:.0e}."
        return cycle.orbit().replace(status=f"{cycle.status} {why}")
    errors, cut = {**(orbit.errors or {}), "waveform": error}, orbit
    if orbit.H > H:
        cut = orbit.replace(coefficients=fourier.resize(orbit.coefficients, H))
        errors |= {c: abs(cut.amplitude(c) - orbit.amplitude(c)) for c in orbit.coordinates}
    enough = "meets" if error <= tolerance else "misses"
    return cut.replace(
        errors=errors,
        status=f"{orbit.status} Harmonics up to {cut.H} are given; their error {error:.1e} {enough} {tolerance:.0e}.",
    )


def _isolated(equations: Equations, orbit: Orbit) -> bool:
    """Tell whether a cycle is the only one near by: whether the Jacobian at fixed parameters is regular."""
    equations = equations.phased(orbit)
    z, p = equations.encode(orbit), equations.system.vector(**orbit.parameters)
    J = Problem(equations, Conditions(), p).linearise(z)[1]
    return singularity(scaled(J, equations.residual_scale, equations.scale)) > 1e-9
