"""All cycles at one parameter value, without a guess."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hbbogie.continuation import trace
from hbbogie.equations import Equations
from hbbogie.errors import ConvergenceError, ModelError
from hbbogie.guesses import hopf_points
from hbbogie.integration import positive
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.results import Branch, Orbit, SpecialPoint
from hbbogie.settled import distinct, settled_cycles
from hbbogie.solvers import solve
from hbbogie.stability import floquet
from hbbogie.system import System
from hbbogie.verification import verify

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
    ``find_cycles(system, V=90.0)``
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


def verified(system: System, orbit: Orbit) -> tuple[Orbit, float]:
    """Return the orbit with error estimates and their largest, relative; infinite where shooting does not converge."""
    try:
        checked = verify(system, orbit)
    except ConvergenceError as error:
        return orbit.replace(status=f"{orbit.status}; no error estimate: {error}"), np.inf
    errors = {"omega": abs(checked.omega_error), "waveform": checked.waveform_error}
    errors |= {name: abs(e) for name, e in checked.amplitude_errors.items()}
    stability = checked.orbit.stability
    if stability is not None:
        stability = replace(stability, mode=floquet(system, orbit).mode)
    return orbit.replace(errors=errors, stability=stability), max(errors["omega"] / orbit.omega, errors["waveform"])


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


def default_reach(system: System, parameter: str) -> tuple[float, float]:
    """Return twice the value of a parameter (at least 1) to either side, within its bounds."""
    (low, high), value = system.parameter(parameter).bounds, system.values[parameter]
    reach = max(2 * abs(value), 1.0)
    return max(value - reach, low), min(value + reach, high)


def branches_from_hopf(
    equations: Equations, parameter: str, interval: tuple[float, float], *, families: bool = True
) -> list[Branch]:
    """Trace the branch that begins at each Hopf point in an interval of the parameter (see `trace`)."""
    return [branch for _, branch in _from_hopf(equations, parameter, interval, families)]


def _from_hopf(
    equations: Equations, parameter: str, interval: tuple[float, float], families: bool
) -> Iterator[tuple[SpecialPoint, Branch]]:
    for hopf in hopf_points(equations.system, parameter, interval):
        try:
            yield hopf, trace(equations, hopf, parameter, interval, families=families, stability=False)
        except ConvergenceError:
            continue  # no cycle of the kept harmonics begins here


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


def crossings(equations: Equations, branch: Branch, value: float) -> list[Orbit]:
    """Return the cycles of a branch at a value of its parameter, solved for exactly.

    Raises
    ------
    ModelError
        When the branch stays at the value: cycles of a conservative system form a family.
    """
    name, V = branch.parameter, branch.values
    at: dict[str, Any] = {name: value}
    near = np.abs(V - value) <= 1e-9 * max(1.0, abs(value), float(np.ptp(V)))
    if (near[:-1] & near[1:]).any():
        raise ModelError(_family(name, value))
    found = []
    for i in np.flatnonzero((V[:-1] - value) * (V[1:] - value) <= 0):
        a, b = branch.orbits[i], branch.orbits[i + 1]
        share = (value - V[i]) / (V[i + 1] - V[i])
        between = a.replace(
            coefficients=(1 - share) * a.coefficients + share * b.coefficients,
            omega=(1 - share) * a.omega + share * b.omega,
        )
        for guess in (between, a, b):
            try:
                found.append(solve(equations, guess, **at))
                break
            except ConvergenceError:
                continue
    return found


def _family(name: str, value: float) -> str:
    return (
        f"the cycles at {name} = {value:g} form a continuous family (as in a conservative system); ask for one by its "
        f"amplitude: solve(equations, guess, amplitude={{coordinate: value}}, free={name!r})."
    )


def _isolated(equations: Equations, orbit: Orbit) -> bool:
    """Tell whether a cycle is the only one near by: whether the Jacobian at fixed parameters is regular."""
    equations = equations.phased(orbit)
    z, p = equations.encode(orbit), equations.system.vector(**orbit.parameters)
    J = equations.derivatives(())(z, p)[1].full() / equations.residual_scale[:, None] * equations.scale
    sizes = np.linalg.svd(J, compute_uv=False)
    return bool(sizes[-1] > 1e-9 * sizes[0])
