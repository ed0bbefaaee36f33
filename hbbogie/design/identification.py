"""Identification: parameters of a system from measured cycles, by constrained least squares.

Every measured row is a cycle of the system, with its own unknowns. The identified parameters theta are common to all
rows. One nonlinear program has the equations of all cycles as constraints and minimises the sum of the squares of
(measured - computed) / sigma, with exact first derivatives and the Gauss-Newton Hessian.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hbbogie.branches.first_cycle import first_cycle
from hbbogie.brief import brief
from hbbogie.design.misfit import IGNORED, Measured, Misfit, Parametrisation
from hbbogie.equilibria.hopf import hopf_points
from hbbogie.errors import ModelError, door
from hbbogie.methods.equations import Equations
from hbbogie.results import Orbit
from hbbogie.results.failure import ConvergenceError
from hbbogie.solving.solvers import solve

Array = NDArray[np.float64]
__all__ = ["Identification", "Parametrisation", "identify"]
OUTLIER = 3.5  # distance from the median, in robust standard deviations (1.4826 MAD)
TUKEY = 4.685  # distance at which the biweight reaches 0
ROUNDS = 20  # largest number of reweightings


@dataclass(frozen=True, eq=False)
class Identification:
    """Identified parameters.

    Attributes
    ----------
    estimates, errors : dict of float
        Estimates of the identified numbers, and their standard errors. The errors are scaled by the misfit found, so
        only the ratios of the sigmas matter.
    correlation : ndarray, shape (number of estimates, number of estimates)
    parameters : dict of float
        The resulting values of the system's parameters.
    quantities : tuple of str
        The measured quantities: the columns of the next two arrays.
    residuals : ndarray, shape (rows, quantities), unit of the quantity
        Measured - computed; NaN where nothing was measured.
    weights : ndarray, shape (rows, quantities)
        Weight of each residual, 0 to 1; 0 for excluded rows, whose cycles are fitted to their own row alone.
    outliers : tuple of int
        Places of rows farther from the median than 3.5 robust standard deviations in some quantity.
    sum_of_squares : float
        Of the weighted residuals, in units of sigma.
    freedom : int
        Degrees of freedom: the number of residuals that count minus the number of unknowns.
    orbits : tuple of Orbit
        The computed cycle of each row.
    status : str
    """

    estimates: dict[str, float]
    errors: dict[str, float]
    correlation: Array
    parameters: dict[str, float]
    quantities: tuple[str, ...]
    residuals: Array
    weights: Array
    outliers: tuple[int, ...]
    sum_of_squares: float
    freedom: int
    orbits: tuple[Orbit, ...]
    status: str

    __repr__ = brief


@door(equations=Equations, rows=Sequence, sigma=Mapping)
def identify(
    equations: Equations,
    rows: Sequence[Mapping[str, float | None]],
    free: Sequence[str] | Parametrisation,
    *,
    sigma: Mapping[str, float],
    exclude: Sequence[int] = (),
    robust: bool = False,
    guesses: Sequence[Orbit] | None = None,
) -> Identification:
    """Identify parameters from measured cycles.

    Parameters
    ----------
    equations : Equations
        The search begins at the values of their system, which also apply to all other parameters.
    rows : sequence of mappings
        The measurements of each cycle: "omega" [rad/s], first-harmonic amplitudes by the name of the coordinate, and
        parameters by name, such as ``{"V": 90.0, "omega": 28.42, "q1": 0.0104, "q3": 0.0097}``. A named parameter has
        its own value in each row, or None where it was not measured. A Hopf point is a row with a small amplitude
        (without contact the amplitude does not matter).
    free : sequence of str, or Parametrisation
        The parameters to identify, or a few numbers on which they depend.
    sigma : mapping from quantity to float, in its unit
        Standard deviation of each measured quantity; 0 for quantities that must be met exactly in each row.
    exclude : sequence of int
        Places of rows that do not count. Their misfit is still shown.
    robust : bool
        Reduce the weight of residuals far from the others (Tukey's biweight on 1.4826 MAD of each quantity).
    guesses : sequence of Orbit, optional
        One for each row. By default, cycles are followed over amplitude from the Hopf point, at the start values.

    Returns
    -------
    Identification

    Raises
    ------
    ConvergenceError
        When a row has no cycle at the start values, or the program does not converge.
    ModelError
        For unknown names, or rows that do not determine the parameters.

    Notes
    -----
    ``robust`` requires rows with more weighted quantities than unknowns of their own. If the parameter depends steeply
    on a weighted amplitude, each row can adapt to one of its quantities, and quantities that agree only for this reason
    are taken for the truth. In that case, hold the amplitude with sigma 0.
    """
    given = free if isinstance(free, Parametrisation) else _one_by_one(equations, free)
    table = Measured(equations, rows, sigma)
    if not set(exclude) <= set(range(len(rows))):
        raise ModelError(f"identify: exclude={tuple(exclude)}; give places of rows, 0 to {len(rows) - 1}.")
    used = [i for i in range(len(rows)) if i not in set(exclude)]
    program = Misfit(equations, given, table.only(used))
    freedom = _freedom(program)
    orbits = list(guesses) if guesses is not None else _walk(equations, table)
    if len(orbits) != len(rows):
        raise ModelError(f"identify: got {len(orbits)} guesses for {len(rows)} rows; give one for each.")
    weights = np.where(np.isfinite(program.table.measured), 1.0, 0.0)
    x = program.solve(program.start([orbits[i] for i in used]), weights)
    for _ in range(ROUNDS if robust else 0):
        misfit = program.misfit(x)
        distance = _distance(misfit, misfit, table.sigma)
        before, full = weights, np.isfinite(program.table.measured)
        weights = np.where(full, np.maximum(1 - (distance / TUKEY) ** 2, IGNORED), 0.0)
        polished = program.polish(x, weights)
        x = program.solve(x, weights) if polished is None else polished
        if np.abs(weights - before).max() < 1e-4:
            break
    everything = np.zeros_like(table.measured), np.full_like(table.measured, np.nan)
    everything[0][used], everything[1][used] = weights, program.misfit(x)
    for i, orbit in zip(used, program.orbits(x), strict=True):
        orbits[i] = orbit
    fixed = replace(equations, system=equations.system.with_parameters(**program.parameters(x)))
    for i in set(exclude):
        everything[1][i], orbits[i] = _aside(fixed, table.only([i]), orbits[i])
    return _result(program, x, weights, freedom, everything, tuple(orbits))


def _freedom(program: Misfit) -> int:
    """Return the number of residuals minus the number of unknowns; raise `ModelError` if it is negative."""
    table, unknowns = program.table, len(program.given.start)
    counted = int(np.isfinite(table.measured[:, table.weighed]).sum())
    freedom = counted - unknowns - len(table.measured) * (len(table.own) - len(table.held))
    if freedom < 0:
        raise ModelError(
            f"identify: {counted} measured quantities do not determine {unknowns} parameters; give more rows, or hold "
            "more quantities with sigma 0."
        )
    return freedom


def _aside(equations: Equations, table: Measured, orbit: Orbit) -> tuple[Array, Orbit]:
    """Return misfit and cycle of an excluded row at the identified parameters; NaN if it has no cycle."""
    program = Misfit(equations, Parametrisation({}, dict), table)
    try:
        x = program.solve(program.start([orbit]), np.where(np.isfinite(table.measured), 1.0, 0.0))
    except ConvergenceError:
        return np.full(len(table.names), np.nan), orbit.replace(status="no cycle found at the identified parameters")
    return program.misfit(x)[0], program.orbits(x)[0]


def _result(
    program: Misfit, x: Array, weights: Array, freedom: int, everything: tuple[Array, Array], orbits: tuple[Orbit, ...]
) -> Identification:
    table = program.table
    squares = float(np.nansum((weights * program.misfit(x))[:, table.weighed] ** 2 / table.sigma[table.weighed] ** 2))
    covariance = program.covariance(x, weights)
    size = np.sqrt(np.diag(covariance))
    errors = size * (np.sqrt(squares / freedom) if freedom else np.nan)
    names = tuple(program.given.start)
    distance = _distance(everything[1], program.misfit(x), table.sigma)
    outliers = tuple(int(i) for i in np.flatnonzero((distance > OUTLIER).any(axis=1)))
    return Identification(
        dict(zip(names, map(float, program.theta(x)), strict=True)),
        dict(zip(names, map(float, errors), strict=True)),
        covariance / np.outer(size, size),
        program.parameters(x),
        table.names,
        everything[1],
        everything[0],
        outliers,
        squares,
        freedom,
        orbits,
        f"{program.status}; {freedom} degrees of freedom, {len(outliers)} outlying rows",
    )


def _one_by_one(equations: Equations, names: Sequence[str]) -> Parametrisation:
    system = equations.system
    if isinstance(names, str) or not names:
        raise ModelError(f"identify: free={names!r}; give a sequence of parameter names, such as ('f11', 'f22').")
    return Parametrisation({n: system.values[system.parameter(n).name] for n in names}, lambda **theta: theta)


def _distance(misfit: Array, counted: Array, sigma: Array) -> Array:
    """Return the distance from the median of the rows that count, in robust standard deviations (1.4826 MAD)."""
    distance = np.zeros_like(misfit)
    for k in np.flatnonzero(np.isfinite(counted).any(axis=0) & (sigma > 0)):
        r = counted[np.isfinite(counted[:, k]), k]
        median = np.median(r)
        # at least a thousandth of sigma, so that exact data have no outliers
        spread = max(1.4826 * float(np.median(np.abs(r - median))), 1e-3 * sigma[k])
        distance[:, k] = np.where(np.isfinite(misfit[:, k]), np.abs(misfit[:, k] - median) / spread, 0.0)
    return distance


def _walk(equations: Equations, table: Measured) -> list[Orbit]:
    """Return a cycle for each row at the start values, following growing amplitudes from the Hopf point."""
    system = equations.system
    places = [k for k, n in enumerate(table.names) if n in system.coordinate_names]
    places = [k for k in places if np.isfinite(table.measured[:, k]).all()]
    if len(table.own) != 1 or not places:
        raise ModelError(
            "identify: give guesses=..., one orbit for each row; without guesses, one amplitude has to be "
            "measured in every row, and exactly one parameter has to have its own value in each."
        )
    parameter, coordinate = system.parameters[table.own[0]], table.names[places[0]]
    known = table.measured[:, table.names.index(parameter.name)]
    known = known[np.isfinite(known)]
    interval = (float(known.min()) / 2, 2 * float(known.max())) if len(known) and known.min() > 0 else parameter.bounds
    hopf = hopf_points(system, parameter.name, interval)
    if not hopf:
        raise ConvergenceError(f"identify: no Hopf point for {parameter.name} in {interval}; give guesses=...")
    typical = float(np.median(known)) if len(known) else 0.0
    orbit = first_cycle(equations, min(hopf, key=lambda h: abs(h.value - typical)))
    found: dict[int, Orbit] = {}
    a = orbit.first_harmonic(coordinate)
    for i in np.argsort(table.measured[:, places[0]]):
        target = float(table.measured[i, places[0]])
        step = 1.0
        while a != target:
            new = a + step * (target - a)
            guess = orbit.replace(coefficients=orbit.coefficients * new / orbit.first_harmonic(coordinate))
            try:
                orbit = solve(equations, guess, amplitude={coordinate: new}, free=parameter.name)
                a, step = new, 1.0
            except ConvergenceError:
                step /= 2
                if step < 1e-3:
                    raise
        found[int(i)] = orbit
    return [found[i] for i in range(len(table.measured))]
