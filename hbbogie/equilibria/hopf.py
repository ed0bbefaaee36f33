"""Hopf points of all equilibria over an interval of a parameter."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hbbogie.equilibria.census import Start, census
from hbbogie.equilibria.crossings import Crossing, Crossings, crossings
from hbbogie.equilibria.curve import RestBranch
from hbbogie.equilibria.rest import Rest
from hbbogie.errors import door
from hbbogie.model.ranges import check_interval
from hbbogie.model.system import System
from hbbogie.results import HopfPoints, Orbit, SpecialPoint
from hbbogie.results.equilibria import in_order
from hbbogie.results.periodic import FourierSeries

Array = NDArray[np.float64]
ZERO = 1e-12  # share of the interval up to which a value is zero


@door(system=System, parameter=str)
def hopf_points(
    system: System, parameter: str, interval: tuple[float, float], *, start: Start | None = None
) -> HopfPoints:
    """Find the Hopf points of all equilibria over an interval of a parameter.

    Along each branch of equilibria (see `find_equilibria`) eigenvalues are matched from point to point, and steps are
    refined where one crosses the imaginary axis or comes near it. Each point is the solution of F = 0,
    P(i omega) z = 0, c.z = 1 in equilibrium, mode, frequency and parameter, and lies inside the step that led to it.

    Parameters
    ----------
    system : System
    parameter : str
    interval : (float, float), unit of the parameter
    start : Orbit, Trajectory, mapping from name to value or sequence of float, optional
        A state: only the branch of equilibria near it is looked at.

    Returns
    -------
    HopfPoints : list of SpecialPoint, kind "hopf", in increasing order of the parameter
        Each orbit is the linear cycle along the critical mode whose largest coordinate is 1 in its unit. The status
        says how many pairs of eigenvalues cross where they are several. The list carries ``evidence``: what was
        searched, which eigenvalues stay on the axis, what is not located.

    Raises
    ------
    ModelError
        For an unknown parameter, an empty interval or a start that is no state.

    References
    ----------
    Yu. A. Kuznetsov, Elements of Applied Bifurcation Theory, section 10.2 (eq-hopf).
    """
    span = check_interval(system, parameter, interval)
    parts, notes = census(system, parameter, span, start)
    points: list[SpecialPoint] = []
    evidence, undecided = list(notes), list[str]()
    for part in parts:
        for branch in part.branches:
            found = crossings(part.rest, part.box, branch)
            points += hopf_specials(part.rest, span, found)
            evidence += branch_evidence(part.rest, branch, found)
            undecided += [*found.undecided, *(f"equilibria: {end}" for end in branch.ends if not end.complete)]
    return HopfPoints(in_order(points, span), tuple(evidence), tuple(undecided))


def hopf_specials(rest: Rest, span: tuple[float, float], found: Crossings) -> list[SpecialPoint]:
    """Return the Hopf points of a branch."""
    return [_special(rest, span, crossing, found.found) for crossing in found.found]


def _special(rest: Rest, span: tuple[float, float], c: Crossing, others: tuple[Crossing, ...]) -> SpecialPoint:
    system, value = rest.system, float(c.u[-1])
    if abs(value) < ZERO * (span[1] - span[0]):
        value = 0.0
    mode = c.z / c.z[np.argmax(np.abs(c.z))]
    coefficients = np.array([c.u[: system.n], mode.real, -mode.imag])
    orbit = orbit_at(rest, value, coefficients, c.omega, "the linear cycle along the critical mode")
    pairs = {1: "a pair", 2: "a double pair (2 pairs)"}.get(c.pairs, f"{c.pairs} pairs")
    verb = ("gains" if c.gains else "loses") if c.pairs < 3 else ("gain" if c.gains else "lose")
    status = f"{pairs} of eigenvalues {verb} a positive real part; real part {c.real:.1e} 1/s where located"
    beside = [o.omega for o in others if o is not c and np.allclose(o.u, c.u, rtol=1e-9, atol=1e-12)]
    for omega in beside:
        status += f"; another pair crosses at the same value, omega = {omega:.6g} rad/s"
    width = 1e-13 * max(abs(value), span[1] - span[0])
    return SpecialPoint("hopf", rest.parameter, value, (value - width, value + width), orbit, status)


def orbit_at(rest: Rest, value: float, coefficients: Array, omega: float, status: str) -> Orbit:
    """Return an orbit at a value of the parameter."""
    system = rest.system
    units = tuple(c.unit for c in system.coordinates)
    values = dict(zip(system.parameter_names, map(float, rest.vector(value)), strict=True))
    return Orbit(
        system.name,
        system.coordinate_names,
        units,
        FourierSeries(coefficients),
        omega,
        values,
        "linearisation",
        0.0,
        status,
        naming=system.naming,
    )


def branch_evidence(rest: Rest, branch: RestBranch, found: Crossings) -> list[str]:
    """Return sentences on a branch: where it runs, why it ends, what its eigenvalues do."""
    size = float(branch.scale[-1])
    values = [float(branch.u[i, -1]) for i in (0, -1)]
    unstable = [int(found.unstable[i]) for i in (0, -1)]
    if values[1] < values[0]:
        values, unstable = values[::-1], unstable[::-1]
    ends = branch.ends if branch.u[0, -1] <= branch.u[-1, -1] else branch.ends[::-1]
    named = [(t.kind, float(t.u[-1])) for t in branch.turns] + [("Hopf point", float(c.u[-1])) for c in found.found]
    turns = [f"{kind} at {rest.parameter} = {0.0 if abs(v) < ZERO * size else v:.6g}" for kind, v in named]
    head = (
        f"equilibria from {rest.parameter} = {values[0]:.6g} ({unstable[0]} unstable eigenvalues; {ends[0]}) "
        f"to {values[1]:.6g} ({unstable[1]}; {ends[1]})"
    )
    return [": ".join([head, ", ".join(turns)]) if turns else head, *found.notes]
