"""All equilibria of a system over an interval of a parameter, as branches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hbbogie.deadline import time_is_over
from hbbogie.equilibria.curve import VERTICAL, RestBranch, RestCurve, follow
from hbbogie.equilibria.rest import Level, Rest, conserved
from hbbogie.equilibria.search import NEAR, NOTHING, SLICES, WIDE, Box, at_random, from_rest, newton, relaxed
from hbbogie.equilibria.turns import crossing, turns
from hbbogie.errors import ModelError, unknown_name
from hbbogie.model.conserved import state_names
from hbbogie.model.singular import between_poles, singular_terms
from hbbogie.model.system import System
from hbbogie.results import Orbit, Trajectory

Array = NDArray[np.float64]
COUNTS = (4, 48)  # random starts: of many unknowns, and of few
WORK = 2000  # unknowns times starts
MANY, FEW = 100, 3  # unknowns from which the starts at rest are few, so many
MOST_BRANCHES = 40
IN_FAMILY = 1e-8  # singular value below which an equilibrium from a random start is one of a family, not near a fold
BESIDE = 1e-2  # share of the interval beside an end at a bound at which an equilibrium within the bound is looked for
ROUND_OFF = 1e-9  # share of its scale up to which a coordinate may be zero
CROWD = 1e-8  # share of the interval within which equilibria from random values of the parameter have the same one
RANK = 1e-10  # smallest singular value, relative to the largest, of equations whose solutions form a curve

Start = Orbit | Trajectory | Mapping[str, float] | Sequence[float] | Array


@dataclass(frozen=True, eq=False)
class Part:
    """The branches of equilibria over a part of an interval without poles."""

    rest: Rest
    box: Box
    branches: tuple[RestBranch, ...]


def state_of_start(system: System, parameter: str, start: Start | None) -> tuple[Array, float | None]:
    """Return the coordinates where the search begins, shape (n,), and the value of the parameter that belongs to them.

    Raises
    ------
    ModelError
        For a start that is no state of the system.
    """
    n, names, value = system.n, system.coordinate_names, None
    low, high = (np.array([c.bounds[i] for c in system.coordinates]) for i in (0, 1))
    if start is None:
        return np.clip(np.zeros(n), low, high), None
    if isinstance(start, Orbit | Trajectory):
        if tuple(start.coordinates) != names:
            raise ModelError(f"start: its coordinates are {', '.join(start.coordinates)}, not {', '.join(names)}.")
        value = start.parameters.get(parameter)
        q = start.coefficients[0] if isinstance(start, Orbit) else start.q[-1]
    elif isinstance(start, Mapping):
        allowed = state_names(system)  # the velocities are those of a motion that begins there
        unknown = [name for name in start if name not in allowed]
        if unknown:
            raise ModelError(f"start: {unknown_name('state', unknown[0], allowed)}")
        q = np.array([start.get(name, 0.0) for name in names])
    else:
        q = start
    try:
        x = np.asarray(q, dtype=float).ravel()
    except (TypeError, ValueError):
        x = np.full(1, np.nan)
    if len(x) not in (n, system.n_states) or not np.isfinite(x).all():
        raise ModelError(
            f"start: got {start!r}; give a state of {n} finite numbers ({', '.join(names)}), values by name, "
            "an orbit or a trajectory."
        )
    return x[:n], value


def census(
    system: System, parameter: str, interval: tuple[float, float], start: Start | None = None
) -> tuple[list[Part], tuple[str, ...]]:
    """Return the branches of equilibria over an interval, and sentences on what was searched.

    Parameters
    ----------
    system : System
    parameter : str
    interval : (float, float), unit of the parameter
    start : see `find_equilibria`
    """
    spans, notes = between_poles(system, parameter, interval)
    state, value = state_of_start(system, parameter, start)
    parts, said = [], list(notes)
    if value is None and start is not None:
        value = system.values[parameter]
    for span in spans:
        if start is not None and value is not None and len(spans) > 1 and not span[0] <= value <= span[1]:
            continue
        at = tuple(span[0] + share * (span[1] - span[0]) for share in (0.31, 0.72))
        level = conserved(system, parameter, (at[0], at[1]), state)
        part, sentences = _part(Rest(system, parameter, level), span, state, value if start is not None else None)
        parts.append(part)
        said += [s for s in sentences if s not in said]
    return parts, tuple(said)


def _part(rest: Rest, span: tuple[float, float], state: Array, value: float | None) -> tuple[Part, list[str]]:
    """Return the branches over a part of the interval; those through the start only where it has a value."""
    box = Box.of(rest, span)
    few = len(box.scale) > MANY
    u, normals = from_rest(rest, box, state, FEW if few else len(SLICES))
    if value is not None:
        u[0, -1] = np.clip(value, *span)
    roots, found = newton(rest, u, normals, box)
    found &= box.holds(roots)
    lost = np.flatnonzero(~found)
    if len(lost):  # let motions approach an equilibrium first
        roots[lost], found[lost] = newton(rest, relaxed(rest, u[lost], box.scale), normals[lost], box)
        found &= box.holds(roots)
    notes = _not_smooth(rest, u)
    family = _family(rest, box, roots[found])
    if family is not None:
        return _part(replace(rest, level=family), span, state, value)
    if value is not None:
        branches = _followed(rest, box.seen(rest, roots[found]), roots[found][:1], False, notes)
        return Part(rest, box, tuple(branches)), [*rest.level.text, *notes]
    count = int(np.clip(WORK // len(box.scale), *COUNTS))
    known, tried, converged, outside, in_families = roots[found], len(u), int(found.sum()), 0, np.empty(0)
    rounds = () if not rest.system.nonlinear_coordinates else (WIDE, NEAR) if few else (WIDE, NEAR, NEAR)
    for seed, decades in enumerate(rounds):
        if seed and converged == tried and (np.abs(known) <= NOTHING * box.scale)[:, : rest.system.n].all():
            break  # every start has led to zero
        u, normals, free = at_random(rest, box, count, decades, seed)
        roots, found = newton(rest, u, normals, box, free)
        inside = found & box.holds(roots)
        tried, converged, outside = tried + count, converged + int(found.sum()), outside + int((found & ~inside).sum())
        roots = roots[inside]
        alone = ~rest.singular(roots, IN_FAMILY) if len(roots) else inside[:0]
        alone &= ~(free[inside] & _crowded(roots[:, -1], free[inside], span))
        in_families = np.append(in_families, roots[~alone, -1])
        known = np.concatenate([known, roots[alone]])
        box = box.seen(rest, known)
    edgy = _at_edges(rest, box, known)
    if edgy.any():
        notes.append(f"{int(edgy.sum())} roots are round-off beside states at which there is no derivative: left out")
    branches = _followed(rest, box, known[~edgy], True, notes)
    where = f"{rest.parameter} from {span[0]:.6g} to {span[1]:.6g}"
    beyond = f", {outside} of them beyond the bounds of the coordinates" if outside else ""
    head = f"{where}: {tried} starts of Newton's method at rest and in random states, {converged} converged{beyond}"
    if len(in_families):
        low, high = (0.0 if abs(v) < 1e-9 * (span[1] - span[0]) else v for v in (in_families.min(), in_families.max()))
        place = (
            f"at {rest.parameter} = {low:.6g}"
            if high - low < 1e-6 * (span[1] - span[0])
            else (f"from {rest.parameter} = {low:.6g} to {high:.6g}")
        )
        notes.append(
            f"equilibria that form continuous families {place} are not followed: scripts can give one as start="
        )
    notes.insert(0, head)
    return Part(rest, box, tuple(branches)), [*rest.level.text, *notes]


def _crowded(values: Array, free: NDArray[np.bool_], span: tuple[float, float]) -> NDArray[np.bool_]:
    """Tell which values of the parameter two more of the free starts have come to: theirs is a family at one value."""
    width = span[1] - span[0]
    inside = (values - span[0] > CROWD * width) & (span[1] - values > CROWD * width)
    near = np.abs(values[:, None] - values) <= CROWD * width
    return np.asarray(inside & ((near & free).sum(axis=1) > 2))


def _followed(rest: Rest, box: Box, roots: Array, switching: bool, notes: list[str]) -> list[RestBranch]:
    """Return the branches through equilibria, each once, and those that cross them."""
    branches: list[RestBranch] = []
    queue, lost = list(roots.copy()), 0
    for name in np.array(rest.system.coordinate_names)[rest.angles]:
        notes.append(f"{name} is an angle: equilibria are those of one turn")
    curve = RestCurve(rest, box, box.scale)
    while queue and len(branches) < MOST_BRANCHES and not time_is_over():
        u = queue.pop(0)
        whole = rest.turns[rest.angles]
        u[: rest.system.n][rest.angles] = (u[: rest.system.n][rest.angles] + whole / 2) % whole - whole / 2
        if any(b.passes(curve, u) for b in branches):
            continue
        branch = follow(rest, box.about(rest, u), u)
        if branch is None or np.ptp(branch.u[:, -1]) <= VERTICAL * box.scale[-1]:
            lost += not time_is_over()
            continue
        branch = replace(branch, turns=turns(rest, box, branch))
        twin = next((k for k, other in enumerate(branches) if _same(curve, other, branch)), None)
        if twin is not None:  # one of them ended early
            branches[twin] = max(branches[twin], branch, key=lambda b: b.length)
            continue
        branches.append(branch)
        if queue:
            elsewhere = ~branch.holds(curve, np.array(queue))
            queue = [u for u, other in zip(queue, elsewhere, strict=True) if other]
        for turn in branch.turns if switching else ():
            queue += crossing(rest, box, branch, turn)
        if switching:
            queue += _on_bounds(rest, box, branch)
    if time_is_over():
        notes.append("the time limit was reached: not all equilibria found were followed")
    elif queue and len(branches) == MOST_BRANCHES:
        notes.append(f"the search ended with {MOST_BRANCHES} branches of equilibria: there may be more")
    if lost:
        notes.append(f"{lost} equilibria found could not be followed: the equations are singular there")
    return branches


def _on_bounds(rest: Rest, box: Box, branch: RestBranch) -> list[Array]:
    """Return equilibria beside the ends of a branch at bounds of coordinates, where one within the bound crosses."""
    ends = [branch.u[place] for place, end in zip((0, -1), branch.ends, strict=True) if end.kind == "bound"]
    if not ends:
        return []
    across = np.eye(len(box.scale))[-1]
    u = np.array([end + side * BESIDE * box.scale * across for end in ends for side in (-1, 1)])
    roots, found = newton(rest, u, np.tile(across, (len(u), 1)), box)
    return list(roots[found & box.holds(roots)])


def _same(curve: RestCurve, a: RestBranch, b: RestBranch) -> bool:
    """Tell whether two branches are one: whether one passes through two points of the other."""
    short, long = sorted((a, b), key=lambda branch: branch.length)
    return all(long.passes(curve, short.u[(len(short.u) * k) // 3]) for k in (1, 2))


def _family(rest: Rest, box: Box, roots: Array) -> Level | None:
    """Return a level that singles out one of a continuous family of equilibria, or None where there is none."""
    n, level = rest.system.n, rest.level
    if len(roots) < 2:
        return None
    _, J = rest.evaluate(roots[:2])
    rows = rest.rows(J, box.scale)
    matrices = J / rows[:, :, None] * np.where(box.scale > 0, box.scale, 1.0)
    if not np.isfinite(matrices).all():
        return None
    sizes = np.linalg.svd(matrices, compute_uv=False)
    if not (sizes[:, -1] <= RANK * sizes[:, 0]).all():
        return None
    left, s, right = np.linalg.svd(matrices[0][:, :-1])
    count = int((s <= RANK * s[0]).sum())
    directions = (left[:n, len(s) - count :] * rows[0][:n, None]) / np.abs(rows[0][:n]).max()
    held = right[len(s) - count :, :n] / box.scale[:n]
    held = held / np.abs(held).max(axis=1, keepdims=True)
    text = f"equilibria form a continuous family of {count} dimension(s): the one nearest the start is followed"
    return Level(
        np.concatenate([level.directions, directions], axis=1),
        np.concatenate([level.rows, held]),
        np.concatenate([level.held, held @ roots[0][:n]]),
        level.zeros + count,
        (*level.text, text),
    )


def _at_edges(rest: Rest, box: Box, roots: Array) -> NDArray[np.bool_]:
    """Tell which roots have coordinates within round-off of zero, where the equations have no derivative."""
    n = rest.system.n
    if not len(roots):
        return np.zeros(0, dtype=bool)
    q = roots[:, :n]
    snapped = np.concatenate([np.where(np.abs(q) <= ROUND_OFF * box.scale[:n], 0.0, q), roots[:, n:]], axis=1)
    with np.errstate(all="ignore"):
        return np.asarray((snapped != roots).any(axis=1) & ~np.isfinite(rest.raw(snapped)[1]).all(axis=(1, 2)))


def _not_smooth(rest: Rest, u: Array) -> list[str]:
    """Return sentences on starts at which the equations or their derivatives are not finite."""
    with np.errstate(all="ignore"):
        G, J = rest.raw(u)
    if np.isfinite(G).all() and np.isfinite(J).all():
        return []
    i = int(np.flatnonzero(~(np.isfinite(G).all(axis=1) & np.isfinite(J).all(axis=(1, 2))))[0])
    system = rest.system
    guilty = singular_terms(system).vanishing(u[i, : system.n], rest.vector(u[i, -1]))
    what = "the derivatives of the equations are" if np.isfinite(G[i]).all() else "the equations are"
    bad = ~np.isfinite(G[i]) if not np.isfinite(G[i]).all() else ~np.isfinite(J[i]).all(axis=1)
    rows = ", ".join(str(k + 1) for k in np.flatnonzero(bad))
    where = ", ".join(f"{n} = {x:.4g}" for n, x in zip(system.coordinate_names, u[i], strict=False))
    why = f": {', '.join(guilty)}, which vanishes or is negative there" if guilty else ""
    if any("has the root of" in sentence for sentence in guilty):
        why += " (hbbogie.model.magnitude(x, y) is the root of a sum of squares with its derivatives at rest)"
    return [f"at {where} {what} not finite (equation {rows}){why}; equilibria were searched for around it"]
