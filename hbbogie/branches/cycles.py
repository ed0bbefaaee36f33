"""All cycles at one parameter value, without a guess."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hbbogie import fourier
from hbbogie.branches.census import Census
from hbbogie.branches.crossing import family_message
from hbbogie.branches.judging import verified
from hbbogie.branches.same import once_each, samples
from hbbogie.branches.simulated import NEAR, settled_cycles
from hbbogie.deadline import time_is_over, time_limit
from hbbogie.equilibria.census import Start
from hbbogie.errors import ModelError, door, positive, whole
from hbbogie.methods.equations import Equations
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.model.ranges import check_interval
from hbbogie.model.system import System
from hbbogie.results import Cycles, Orbit
from hbbogie.results.failure import ConvergenceError
from hbbogie.solving.solvers import solve
from hbbogie.stability.multipliers import floquet

Array = NDArray[np.float64]
LATE = "the time limit was reached"
ORDERS = (15, 31, 63, 127)  # highest harmonics tried in turn
POLISHED = ("multiple shooting", "exact", "collocation")  # methods whose frequency needs no harmonics


@door(system=System, parameter=str)
def find_cycles(
    system: System,
    *,
    parameter: str | None = None,
    interval: tuple[float, float] | None = None,
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
    from every Hopf point on them, and motions simulated from beside the equilibria and from random states. Each
    candidate is polished by shooting, and what is returned is the polished cycle with its own multipliers; two
    candidates that lead to one cycle are one. A cycle that no Hopf point in reach leads to, and that none of the
    motions comes near, is not found: ``evidence`` says what was looked at.

    Parameters
    ----------
    system : System
    parameter : str, optional
        The parameter along which branches are traced; by default the first one given in ``values``, else
        the system's first.
    interval : (float, float), optional, unit of the parameter
        Where to look for Hopf points; by default twice the value (at least 1) to either side, within the
        parameter's bounds.
    harmonics : int or "auto"
        Highest harmonic. "auto" gives the polished cycle with 15, 31, 63 or 127 harmonics, as the tolerance takes, or
        as many as it has. With a number the cycles of harmonic balance next to the polished ones are given.
    tolerance : float
        Largest error of the waveform, relative to the peak, that "auto" is content with. The frequency is that of the
        polished cycle.
    stability : bool
        Whether to compute Floquet multipliers and the verdict, and the error estimates by shooting.
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
        no limit of time cut the search short.

    Raises
    ------
    ModelError
        For wrong names or values, or when the cycles at this value form a continuous family.
    ConvergenceError
        When there is no cycle found, and simulated motions leave it undecided whether there is one.

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
    name = system.parameter(name).name
    interval = check_interval(system, name, interval)
    with time_limit(limit):
        census = Census(system, name, interval, start, system.n_states == 2 if backwards is None else backwards)
        census.follow_branches()
        census.simulate()
        census.look_in_groups()
        census.look_beside()
        found, undecided = census.found, ""
        if census.family and not found:
            raise ModelError(census.family)
        if census.family:
            census.evidence.append("a candidate is not isolated: it is one of a continuous family, or a fold is near")
        if not found and census.undecided and not census.running and not time_is_over():
            found, undecided = _longer(census)
        late = [f"the time limit of {limit:g} s was reached" if limit else LATE] if time_is_over() else []
        if not found and undecided and not late:
            raise ConvergenceError(undecided, statistics={"evidence": tuple(census.evidence)})
        if not found and not late:
            census.say_none()
        if harmonics == "auto":
            judged = [_enough(o, tolerance) if o.method.startswith(POLISHED) else o for o in once_each(found)]
        else:
            judged = _balanced(census, once_each(found), int(harmonics), stability)
    judged = [o if stability else o.replace(stability=None) for o in judged]
    return Cycles(judged, [*late, *census.evidence], late)


def _longer(census: Census) -> tuple[list[Orbit], str]:
    """Let motions settle for as long as it takes, forwards and backwards in time; return cycles and what is open."""
    system, name = census.system, census.parameter
    for H in ORDERS:
        try:
            settled = settled_cycles(HarmonicBalance(H).equations(system), name)
        except ConvergenceError as error:
            if error.statistics.get("unresolved", True) and ORDERS[-1] != H:
                continue
            if error.orbit is not None and (polished := census.polished(error.orbit)) is not None:
                return [polished], ""
            census.evidence.append(f"motions of up to the longest time: {error}")
            return [], str(error)
        for cycle in settled:
            if not _isolated(HarmonicBalance(H).equations(system), cycle):
                raise ModelError(family_message(system, name, cycle))
        for cycle in settled:
            census.consider(cycle, "a motion that settles")
        census.evidence.append(f"motions of up to the longest time settle on {len(settled)} cycle(s)")
        return census.found, ""
    return [], ""


def _balanced(census: Census, found: list[Orbit], H: int, stability: bool) -> list[Orbit]:
    """Return the cycles of harmonic balance with harmonics up to H next to those found."""
    system, kept, failed = census.system, [], None
    equations = HarmonicBalance(H).equations(system)
    for orbit in found:
        try:
            near = solve(equations, orbit, method="newton")
            if abs(near.omega / orbit.omega - 1) > NEAR:
                raise ConvergenceError(f"they lead to another period, {near.period:.6g} s", orbit=near)
            kept.append(_judged(system, near) if stability else near)
        except ConvergenceError as error:
            failed = (
                f"{equations.method} do not resolve the cycle of period {orbit.period:.6g} s "
                f"(ask for more with harmonics=...): {error}"
            )
            census.evidence.append(failed)
    if failed and not kept:
        raise ConvergenceError(failed, orbit=found[-1])
    return kept


def _judged(system: System, orbit: Orbit) -> Orbit:
    """Return the orbit with error estimates and the verdict on itself, whatever its errors."""
    return verified(system, orbit)[0].replace(stability=floquet(system, orbit))


def _enough(orbit: Orbit, tolerance: float) -> Orbit:
    """Return a polished cycle with as many harmonics as the tolerance takes."""
    peaks = np.abs(samples(orbit)).max(axis=0)
    size = np.maximum(peaks, np.finfo(float).tiny)
    moving = size > 1e-12 * size.max()
    waves = np.hypot(orbit.coefficients[1::2], orbit.coefficients[2::2])
    for H in (*ORDERS, orbit.H):
        if H >= orbit.H:
            cut, error = orbit, max(orbit.tail, (orbit.errors or {})["waveform"])
            break
        left = float((waves[H:].sum(axis=0) / size)[moving].max())  # no less than the largest distance
        cut, error = orbit.replace(coefficients=fourier.resize(orbit.coefficients, H)), left
        if error <= tolerance:
            break
    errors = {**(orbit.errors or {}), "waveform": error}
    if cut is not orbit:
        errors |= {c: abs(cut.amplitude(c) - peak) for c, peak in zip(orbit.coordinates, peaks, strict=True)}
    enough = "meets" if error <= tolerance else "misses"
    return cut.replace(
        errors=errors,
        status=f"{orbit.status} Harmonics up to {cut.H} are given; their error {error:.1e} {enough} {tolerance:.0e}.",
    )


def _isolated(equations: Equations, orbit: Orbit) -> bool:
    """Tell whether a cycle is the only one near by: whether the Jacobian at fixed parameters is regular."""
    equations = equations.phased(orbit)
    z, p = equations.encode(orbit), equations.system.vector(**orbit.parameters)
    J = equations.derivatives(())(z, p)[1].full() / equations.residual_scale[:, None] * equations.scale
    sizes = np.linalg.svd(J, compute_uv=False)
    return bool(sizes[-1] > 1e-9 * sizes[0])
