"""All equilibria over an interval of a parameter, as branches of orbits."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hbbogie.equilibria.census import Part, Start, census
from hbbogie.equilibria.crossings import REAL, Crossings, crossings
from hbbogie.equilibria.curve import RestBranch
from hbbogie.equilibria.hopf import branch_evidence, hopf_specials, orbit_at
from hbbogie.equilibria.rest import Rest
from hbbogie.equilibria.spectrum import ON_AXIS
from hbbogie.equilibria.turns import crossing
from hbbogie.errors import door
from hbbogie.model.ranges import check_interval
from hbbogie.model.system import System
from hbbogie.results import Branch, Equilibria, Orbit, SpecialPoint, Stability

Array = NDArray[np.float64]


@door(system=System, parameter=str)
def find_equilibria(
    system: System, parameter: str, interval: tuple[float, float], *, start: Start | None = None
) -> Equilibria:
    """Find the equilibria over an interval of a parameter: branches by arclength, around folds and onto others.

    Damped Newton's method is started at rest and in random states at many values of the parameter, in the declared
    bounds of the coordinates or over decades of their scales. A branch is followed through every equilibrium that lies
    on none of those known, and through every branch point met. Linear quantities that the equations conserve are held
    at the level of the start. Poles of the equations divide the interval.

    Parameters
    ----------
    system : System
    parameter : str
    interval : (float, float), unit of the parameter
    start : Orbit, Trajectory, mapping from name to value or sequence of float, optional
        A state: only the branch near it is followed, at its own level of what is conserved.

    Returns
    -------
    Equilibria
        A tuple of `Branch` of orbits with H = 0, with their stability, folds, branch points and Hopf points, and
        ``evidence``: what was searched and why each branch ended. A search from random states is no proof: an
        equilibrium that no start leads to, and no branch, is not found.

    Raises
    ------
    ModelError
        For an unknown parameter, an empty interval or a start that is no state.

    Examples
    --------
    ``find_equilibria(system, "V", (60.0, 190.0))``
    """
    span = check_interval(system, parameter, interval)
    parts, notes = census(system, parameter, span, start)
    branches, evidence = [], list(notes)
    for part in parts:
        for branch in part.branches:
            found = crossings(part.rest, part.box, branch)
            branches.append(_dressed(part, span, branch, found))
            evidence += branch_evidence(part.rest, branch, found)
    return Equilibria(tuple(branches), parameter, span, tuple(evidence))


def _dressed(part: Part, span: tuple[float, float], branch: RestBranch, found: Crossings) -> Branch:
    """Return a branch as plain data: orbits with their stability, special points in the order met."""
    rest = part.rest
    orbits = [
        _orbit(rest, u, found.values[i], f"equilibrium of F = 0 on a branch over {rest.parameter}")
        for i, u in enumerate(found.u)
    ]
    special = [(c.u, s) for c, s in zip(found.found, hopf_specials(rest, span, found), strict=True)]
    for turn in branch.turns:
        value = float(turn.u[-1])
        onward = crossing(rest, part.box, branch, turn) if turn.across is not None else []
        width = 1e-12 * max(abs(value), span[1] - span[0])
        status = (
            turn.status
            or {"fold": "the branch of equilibria turns", "branch point": "another branch crosses"}[turn.kind]
        )
        special.append(
            (
                turn.u,
                SpecialPoint(
                    turn.kind,
                    rest.parameter,
                    value,
                    (value - width, value + width),
                    _orbit(rest, turn.u, None, status),
                    status,
                    _orbit(rest, onward[0], None, "beside a branch point") if onward else None,
                ),
            )
        )
    size = np.where(np.arange(rest.m + 1) < rest.system.n, branch.scale, np.inf)
    size[-1] = branch.scale[-1]
    place = [int(np.argmin(np.linalg.norm((found.u - u) / size, axis=1))) for u, _ in special]
    order = np.argsort(place, kind="stable")
    return Branch(tuple(orbits), rest.parameter, tuple(special[i][1] for i in order), branch.ends)


def _orbit(rest: Rest, u: Array, values: NDArray[np.complex128] | None, status: str) -> Orbit:
    stability = None if values is None else _stability(rest, values)
    orbit = orbit_at(rest, float(u[-1]), u[None, : rest.system.n], 0.0, status)
    return orbit.replace(method="equilibrium", stability=stability)


def _stability(rest: Rest, values: NDArray[np.complex128]) -> Stability | None:
    """Return the verdict from the eigenvalues, each judged by its own size."""
    if not np.isfinite(values).all():
        return None
    values = values[np.argsort(-values.real, kind="stable")]
    size = np.abs(values)
    growing = int((values.real > REAL * size).sum())
    neutral = int((np.abs(values.real) <= ON_AXIS * size).sum())
    held = f" {rest.level.zeros} more are zero by conservation." if rest.level.zeros else ""
    largest = f"largest real part {values[0].real:.6g} 1/s" if len(values) else "none"
    if growing:
        verdict, reason = "unstable", f"{growing} eigenvalue(s) in the right half plane, {largest}."
    elif neutral:
        verdict, reason = "unknown", f"{neutral} eigenvalue(s) on the imaginary axis, {largest}."
    else:
        verdict, reason = "stable", f"all eigenvalues in the left half plane, {largest}."
    with np.errstate(over="ignore"):
        multipliers = np.exp(np.append(values, np.zeros(rest.level.zeros)))
    critical = complex(multipliers[0]) if len(multipliers) else None
    return Stability(verdict, multipliers, 0.0, growing, reason + held, None, critical)
