"""All cycles at one parameter value, without a guess."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hbbogie.branches.crossing import _family, _from_hopf, crossings
from hbbogie.branches.judging import verified
from hbbogie.branches.simulated import distinct, settled_cycles
from hbbogie.errors import ModelError, positive
from hbbogie.methods.equations import Equations
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.model.ranges import default_reach
from hbbogie.model.system import System
from hbbogie.results import Orbit, SpecialPoint
from hbbogie.results.failure import ConvergenceError
from hbbogie.solving.solvers import solve
from hbbogie.stability.multipliers import floquet
from hbbogie.stability.verification import verify

Array = NDArray[np.float64]
ORDERS = (15, 31, 63, 127)  # highest harmonics tried in turn


def find_cycles(
    system: System,
    *,
    parameter: str | None = None,
    interval: tuple[float, float] | None = None,
    harmonics: int | str = "auto",
    tolerance: float = 1e-3,
    stability: bool = True,
    **values: float,
) -> list[Orbit]:
    """Find the cycles at given parameter values, by growing amplitude; no guess is needed.

    Hopf points of the equilibrium are located over an interval of one parameter, the branches that begin
    there are traced, and every crossing of the given value is solved for. Where that finds nothing,
    motions are simulated from states of several sizes until they settle, forwards and backwards in time. Cycles on
    branches that neither reach a Hopf point in the interval nor attract those motions are not found. The equilibrium
    is the one at zero where that is one, else one near by: write the equations about another one to begin there.

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
        Highest harmonic. "auto" begins with 15 and doubles, up to 127, until the error estimate of each cycle
        meets the tolerance; a cycle that motions settle on and 127 do not resolve is polished by shooting.
    tolerance : float
        Largest error of frequency and waveform, relative, that "auto" is content with.
    stability : bool
        Whether to compute Floquet multipliers and the verdict, and the error estimates by shooting.
    **values : float
        Parameter values, by name.

    Returns
    -------
    list of Orbit
        Empty where no cycle was found.

    Raises
    ------
    ModelError
        For wrong names or values, or when the cycles at this value form a continuous family.
    ConvergenceError
        When the simulated motions leave it undecided whether there is a cycle.

    Examples
    --------
    The period of van der Pol's oscillator at mu = 1 is 6.663287.

    >>> from hbbogie import load_problem
    >>> (cycle,) = find_cycles(load_problem("van_der_pol").van_der_pol(), mu=1.0)
    >>> round(cycle.period, 3), cycle.stability.verdict
    (6.663, 'stable')
    """
    system = system.with_parameters(**values)
    name = parameter or next(iter(values), None) or next(iter(system.parameter_names), None)
    if name is None:
        raise ModelError(f"system {system.name!r} has no parameter to vary; give it one.")
    value, (lo, hi) = system.values[system.parameter(name).name], interval or default_reach(system, name)
    if harmonics != "auto" and not (isinstance(harmonics, int | np.integer) and harmonics >= 1):
        raise ModelError(f"find_cycles: harmonics={harmonics!r}; give a whole number from 1, or 'auto'.")
    tolerance = positive("tolerance", tolerance, "1")
    if harmonics != "auto":
        found = _search(HarmonicBalance(int(harmonics)).equations(system), name, value, (lo, hi))
        return [_judged(system, orbit) for orbit in found] if stability else found
    for H in ORDERS:
        try:
            found = _search(HarmonicBalance(H).equations(system), name, value, (lo, hi))
            break
        except ConvergenceError as error:
            if ORDERS[-1] == H and error.orbit is not None:
                return [_by_shooting(system, error, error.orbit, stability)]
            if ORDERS[-1] == H or not error.statistics.get("unresolved", True):
                raise
    return [_refined(system, orbit, tolerance, stability) for orbit in found]


def _search(equations: Equations, name: str, value: float, interval: tuple[float, float]) -> list[Orbit]:
    """Find the cycles of some equations at a value of a parameter, by branches, else by simulation."""
    found: list[Orbit] = []
    for hopf, branch in _from_hopf(equations, name, interval, families=False):
        small = _before(equations, hopf, branch.orbits[0], value)
        found = distinct([*found, *small, *crossings(equations, branch, value)])
    if not found:
        found = settled_cycles(equations, name)
        if not all(_isolated(equations, cycle) for cycle in found):
            raise ModelError(_family(name, value))
    return found


def _by_shooting(system: System, error: ConvergenceError, motion: Orbit, stability: bool) -> Orbit:
    """Return the cycle that a motion has settled on, polished by shooting, where no harmonics tried resolve it."""
    try:
        found = verify(system, motion)
    except ConvergenceError:
        raise error from None
    orbit = found.orbit
    errors = {"omega": found.closure * orbit.omega, "waveform": orbit.tail}
    status = f"no harmonics up to {ORDERS[-1]} resolve it; a motion settles on it, polished by shooting: {orbit.status}"
    return orbit.replace(errors=errors, status=status, stability=orbit.stability if stability else None)


def _judged(system: System, orbit: Orbit) -> Orbit:
    """Return the orbit with error estimates and the verdict on itself, whatever its errors."""
    return verified(system, orbit)[0].replace(stability=floquet(system, orbit))


def _refined(system: System, orbit: Orbit, tolerance: float, stability: bool) -> Orbit:
    """Return the orbit with as many harmonics as the tolerance takes, judged by the cycle polished by shooting."""
    best, error = verified(system, orbit)
    for H in ORDERS:
        if error <= tolerance or H <= orbit.H:
            continue
        try:
            orbit = solve(HarmonicBalance(H).equations(system), orbit)
        except ConvergenceError:
            break
        best, error = verified(system, orbit)
    if best.stability is None and stability:
        best = best.replace(stability=floquet(system, best))
    enough = "meets" if error <= tolerance else "misses"
    return best.replace(
        stability=best.stability if stability else None,
        status=f"{best.status}; with harmonics up to {best.H} the error estimate {error:.1e} {enough} {tolerance:.0e}",
    )


def _before(equations: Equations, hopf: SpecialPoint, first: Orbit, value: float) -> list[Orbit]:
    """Return the cycle at a value between a Hopf point and the first cycle computed of its branch, if there is one."""
    width = first.parameters[hopf.parameter] - hopf.value
    share = (value - hopf.value) / width if width else 0.0
    if not 0 < share < 1:
        return []
    c = np.sqrt(share) * first.coefficients  # the parameter goes with the square of the amplitude
    c[0] = hopf.orbit.coefficients[0] + share * (first.coefficients[0] - hopf.orbit.coefficients[0])
    try:
        at: dict[str, Any] = {hopf.parameter: value}
        return [solve(equations, first.replace(coefficients=c), method="newton", **at)]
    except ConvergenceError:
        return []


def _isolated(equations: Equations, orbit: Orbit) -> bool:
    """Tell whether a cycle is the only one near by: whether the Jacobian at fixed parameters is regular."""
    equations = equations.phased(orbit)
    z, p = equations.encode(orbit), equations.system.vector(**orbit.parameters)
    J = equations.derivatives(())(z, p)[1].full() / equations.residual_scale[:, None] * equations.scale
    sizes = np.linalg.svd(J, compute_uv=False)
    return bool(sizes[-1] > 1e-9 * sizes[0])
