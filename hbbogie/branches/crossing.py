"""Where branches cross a value of the parameter: the cycles there."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from hbbogie.branches.continuation import trace
from hbbogie.equilibria.hopf import hopf_points
from hbbogie.errors import ModelError
from hbbogie.methods.equations import Equations
from hbbogie.results.branch import Branch, SpecialPoint
from hbbogie.results.failure import ConvergenceError
from hbbogie.results.orbit import Orbit
from hbbogie.solving.solvers import solve


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
