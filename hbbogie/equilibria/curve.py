"""Branches of equilibria: followed by arclength in both directions, with folds and branch points located."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hbbogie.equilibria.rest import Rest
from hbbogie.equilibria.search import Box
from hbbogie.equilibria.spectrum import MANY
from hbbogie.model.singular import singular_terms
from hbbogie.results.ending import Ending
from hbbogie.solving.arclength import correct, landing, walk
from hbbogie.solving.curve import Dense, Point

Array = NDArray[np.float64]
NODES = (65, 17)  # points at which a branch that need not be followed is looked at: of few states, and of many
STEP, LONGEST, MOST = 0.02, 0.1, 400  # in scaled arclength
GROWING, LEGS = 4.0, 30  # a coordinate beyond so many of its scales gets a new one, so many times
FARTHEST = 1e8  # scales of a coordinate beyond which a branch is given up
GROWN = Ending("grown", "coordinates have outgrown their scales")
HOME = Ending("home", "the first point is near")
CLOSED = Ending("closed", "the curve closes on itself")
AROUND = Ending("closed", "it has made a whole turn, and repeats itself")
NEAR_HOME = 0.11  # distance from its first point at which a branch may close
SAME = 1e-6  # scaled distance up to which two equilibria are one
VERTICAL = 1e-8  # share of the interval below which a branch is a family at one value of the parameter


class RestCurve:
    """The equilibria as a curve that `walk` follows, in one set of scales."""

    def __init__(self, rest: Rest, box: Box, scale: Array, home: Array | None = None, first: Array | None = None):
        self.rest, self.box, self.scale, self.tolerance, self.home, self.first = rest, box, scale, 1e-11, home, first
        n = rest.system.n
        self.weights = np.ones(rest.m + 1)
        self.weights[n:-1] = 0.0
        bounded = [i for i in range(n) if np.isfinite([box.low[i], box.high[i]]).any()]
        room = 1e-9 * scale
        self.window = {rest.m: (float(box.low[-1]), float(box.high[-1]))}
        self.window |= {i: (float(box.low[i] - room[i]), float(box.high[i] + room[i])) for i in bounded}

    def evaluate(self, u: Array) -> tuple[Array, Array]:
        """Return the scaled residual and its derivative in the scaled unknowns."""
        with np.errstate(all="ignore"):
            G, J = (a[0] for a in self.rest.evaluate(u[None]))
            rows = self.rest.rows(J, np.maximum(self.scale, np.abs(u)))
            return G / rows, J / rows[:, None] * self.scale

    def settle(self, u: Array) -> None:
        """Take note of nothing."""

    def linearise(self, u: Array) -> Dense:
        """Return the equations and their derivative."""
        return Dense(*self.evaluate(u))

    def where(self, u: Array) -> str:
        """Return the value of the parameter, for people."""
        return f"{self.rest.parameter} = {u[-1]:.6g}"

    def leaves(self, points: Sequence[Point], there: Point) -> Ending | None:
        """Return why this leg ends: coordinates have outgrown their scales, or the first point is near again."""
        u, n, angles = there.u, self.rest.system.n, self.rest.angles
        if self.first is not None and (np.abs(u[:n] - self.first[:n]) > self.rest.turns)[angles].any():
            return AROUND
        if (np.abs(u[:n]) > GROWING * self.scale[:n])[~angles].any():
            return GROWN
        home = self.home is not None and np.linalg.norm((u - self.home) / self.scale * self.weights) < NEAR_HOME
        return HOME if home else None

    def at(self, index: int, value: float) -> Ending:
        """Return the ending at a limit of an unknown."""
        if index == self.rest.m:
            return Ending("interval", f"the end of the interval was reached, {self.rest.parameter} = {value:g}")
        bound = self.box.low[index] if value < self.box.low[index] else self.box.high[index]
        return Ending("bound", f"{self.rest.system.coordinate_names[index]} reaches its bound {bound:.6g}")


@dataclass(frozen=True, eq=False)
class Turn:
    """A fold or branch point: unknowns, and the direction of the branch that crosses."""

    kind: str
    u: Array
    after: int
    across: Array | None = None
    status: str = ""


@dataclass(frozen=True, eq=False)
class RestBranch:
    """A branch of equilibria.

    Attributes
    ----------
    u : ndarray, shape (points, m + 1)
    t : ndarray, shape (points, m + 1)
        Tangents, of length 1 in units of ``scale``.
    scale : ndarray, shape (m + 1,)
    ends : (Ending, Ending)
    turns : tuple of Turn
        Folds and branch points, in order.
    """

    u: Array
    t: Array
    scale: Array
    ends: tuple[Ending, Ending]
    turns: tuple[Turn, ...] = ()

    @property
    def length(self) -> float:
        """Length of the curve in the interval of the parameter, each part counted, unit of the parameter."""
        return float(np.abs(np.diff(self.u[:, -1])).sum())

    def holds(self, curve: RestCurve, u: Array) -> NDArray[np.bool_]:
        """Tell which equilibria, shape (N, m + 1), lie on the lines between its points, which needs no closer look."""
        return np.asarray(self._beside(curve, u)[2].min(axis=1) <= 1e-3 * SAME)

    def passes(self, curve: RestCurve, u: Array) -> bool:
        """Tell whether the branch passes through an equilibrium."""
        scaled, along = self._chords(curve)
        size = np.maximum((along**2).sum(axis=1), 1e-300)
        near, share, off = (x[0] for x in self._beside(curve, u[None]))
        for i in np.argsort(off)[:3]:
            u = near[i] * np.where(curve.weights, scaled, 1.0)
            if off[i] > 0.3 * np.sqrt(size[i]) + SAME:
                continue
            if off[i] <= 1e-3 * SAME:
                return True
            foot, normal = self.u[i] + share[i] * (self.u[i + 1] - self.u[i]), along[i] / np.sqrt(size[i])
            foot = foot + scaled_step(curve, normal, ((u - foot) / curve.scale * curve.weights) @ normal)
            found, _ = correct(curve, foot, normal)
            if found is not None and np.linalg.norm((found.u - u) / curve.scale * curve.weights) <= SAME:
                return True
        return False

    def _chords(self, curve: RestCurve) -> tuple[Array, Array]:
        """Return the scales in which distances are measured, and the scaled lines between successive points."""
        scaled = np.maximum(self.scale, curve.scale) * np.where(curve.weights, 1.0, np.inf)
        return scaled, np.diff(self.u / scaled, axis=0)

    def _beside(self, curve: RestCurve, u: Array) -> tuple[Array, Array, Array]:
        """Return equilibria, scaled, an angle by the turn near each line; their feet on the lines; their distances.

        Each has the shape (N, lines, ...).
        """
        scaled, along = self._chords(curve)
        size = np.maximum((along**2).sum(axis=1), 1e-300)
        turn, u = np.append(curve.rest.turns, np.zeros(curve.rest.level.k + 1)), u[:, None]
        turns = turn * np.round((u - self.u[:-1]) / np.where(turn, turn, np.inf))
        near, a = (u - turns) / scaled, self.u[:-1] / scaled
        share = np.clip(((near - a) * along).sum(axis=-1) / size, 0.0, 1.0)
        return near, share, np.linalg.norm(a + share[..., None] * along - near, axis=-1)


def scaled_step(curve: RestCurve, direction: Array, length: float) -> Array:
    """Return a step along a scaled direction, in the units of the unknowns."""
    return np.asarray(length * curve.scale * direction)


def follow(rest: Rest, box: Box, root: Array) -> RestBranch | None:
    """Return the branch through an equilibrium, or None where none can be followed from it."""
    if not root[:-1].any() and (branch := _at_zero(rest, box)) is not None:
        return branch
    curve = RestCurve(rest, box, box.scale)
    start, along_p = None, np.eye(rest.m + 1)[-1]
    for normal in (along_p, *_null(curve, root)):
        start, _ = correct(curve, root, normal)
        if start is not None and np.isfinite(start.tangent).all() and np.linalg.norm(start.tangent) > 0:
            break
    if start is None:
        return None
    forward, why_end, scale = _legs(rest, box, start)
    if why_end.kind == "closed":
        sides, ends = forward, (why_end, why_end)
    else:
        backward, why_start, other = _legs(rest, box, start.turned())
        sides = [(u, -t) for u, t in backward[:0:-1]] + forward
        scale, ends = np.maximum(scale, other), (why_start, why_end)
    u, t = (np.array([side[i] for side in sides]) for i in (0, 1))
    length = np.linalg.norm(t / scale * curve.weights, axis=1)
    return RestBranch(u, t / length[:, None], scale, ends)


def _at_zero(rest: Rest, box: Box) -> RestBranch | None:
    """Return the branch on which all unknowns but the parameter are zero, where there is one: it need not be followed.

    As elsewhere, a fold or branch point of it shows at the points on both sides.
    """
    nodes = NODES[rest.system.n_states > MANY]
    u = np.zeros((nodes, rest.m + 1))
    u[:, -1] = np.linspace(box.low[-1], box.high[-1], nodes)
    with np.errstate(all="ignore"):
        G, J = rest.evaluate(u)
    if not box.holds(u).all() or G.any() or J[..., -1].any() or not np.isfinite(J).all() or rest.singular(u).any():
        return None
    curve, t = RestCurve(rest, box, box.scale), np.zeros(u.shape)
    t[:, -1] = box.scale[-1]
    ends = [curve.at(rest.m, float(value)) for value in u[[0, -1], -1]]
    return RestBranch(u, t, box.scale, (ends[0], ends[1]))


def _null(curve: RestCurve, u: Array) -> list[Array]:
    """Return the directions in which the equations hold to first order, the surest first."""
    J = curve.evaluate(u)[1]
    return [] if not np.isfinite(J).all() else list(np.linalg.svd(J)[2][::-1][:2])


def _legs(rest: Rest, box: Box, start: Point) -> tuple[list[tuple[Array, Array]], Ending, Array]:
    """Follow a branch in one direction, with larger scales where the coordinates outgrow theirs."""
    curve = RestCurve(rest, box, box.scale, None, start.u)
    point, found = start, [(start.u, box.scale * start.tangent)]
    for leg in range(LEGS):
        points, why = walk(curve, point, step=STEP, longest=LONGEST, most=MOST)
        found += [(p.u, curve.scale * p.tangent) for p in points[1:]]
        if why is HOME:
            closing = correct(curve, start.u, points[-1].tangent * curve.weights)[0]
            if closing is not None and np.linalg.norm((closing.u - start.u) / curve.scale) < SAME:
                return [*found, found[0]], CLOSED, curve.scale
            why, curve = GROWN, RestCurve(rest, box, curve.scale, None, start.u)
        if why is not GROWN:
            if why.kind == "interval":
                found = _to_the_end(curve, found)
            return _inside(curve, found, _reason(rest, curve, points[-1], why))
        if np.ptp([u[-1] for u, _ in found]) <= VERTICAL * box.scale[-1]:
            return found, Ending("vertical", f"{rest.parameter} stays the same along it"), curve.scale
        n = rest.system.n
        if (np.abs(points[-1].u[:n]) > FARTHEST * box.scale[:n]).any():
            break
        scale = curve.scale.copy()
        scale[:n] = np.maximum(scale[:n], 2 * np.abs(points[-1].u[:n]))
        home = start.u if np.linalg.norm((points[-1].u - start.u) / scale) > 2 * NEAR_HOME else None
        curve = RestCurve(rest, box, scale, home, start.u)
        t = found[-1][1] / scale
        point = replace(points[-1], tangent=t / np.linalg.norm(t * curve.weights))
        if leg and len(points) < 2:
            return found, _reason(rest, curve, point, Ending("stuck", "no further point was found")), scale
    largest = int(np.argmax(np.abs(found[-1][0][: rest.system.n]) / box.scale[: rest.system.n]))
    beyond = f"{rest.system.coordinate_names[largest]} goes beyond {found[-1][0][largest]:.2g}"
    return found, Ending("beyond", beyond), curve.scale


def _to_the_end(curve: RestCurve, found: list[tuple[Array, Array]]) -> list[tuple[Array, Array]]:
    """Return a branch with a last point as near the end of the interval as can be: a branch point may lie there."""
    (u, t), m = found[-1], curve.rest.m
    limit = curve.window[m][0 if t[-1] < 0 else 1]
    if u[-1] == limit or t[-1] == 0:
        return found
    for share in (1.0, 1 - 1e-6, 1 - 1e-3, 0.9):
        guess = u + share * (limit - u[-1]) / t[-1] * t
        point, _ = correct(curve, guess, np.eye(m + 1)[-1])
        if point is not None:
            along = np.sign((point.tangent * curve.weights) @ (t / curve.scale)) or 1.0
            return [*found, (point.u, along * curve.scale * point.tangent)]
    return found


def _inside(
    curve: RestCurve, found: list[tuple[Array, Array]], why: Ending
) -> tuple[list[tuple[Array, Array]], Ending, Array]:
    """Return a branch with its last point exactly on the bound that it reaches first."""
    box, n = curve.box, curve.rest.system.n
    last = found[-1][0]
    reached = np.flatnonzero((last < box.low) | (last > box.high))
    if len(found) > 1 and len(reached) and reached[0] < n:
        here, there = (Point(u, along / curve.scale, np.zeros(1)) for u, along in found[-2:])
        for i in reached[reached < n]:
            bound = box.low[i] if last[i] < box.low[i] else box.high[i]
            point = landing(curve, here, there, int(i), float(bound))
            if point is not None and box.holds(point.u[None])[0]:
                u = np.where(np.arange(len(last)) == i, bound, point.u)
                return [*found[:-1], (u, curve.scale * point.tangent)], curve.at(int(i), float(last[i])), curve.scale
    return [*found[:-1], (np.clip(last, box.low, box.high), found[-1][1])], why, curve.scale


def _reason(rest: Rest, curve: RestCurve, last: Point, why: Ending) -> Ending:
    """Return why a branch ends, with what is singular in the equations there."""
    if why.kind in ("interval", "bound", "closed"):
        return why
    beyond = last.u + STEP * curve.scale * last.tangent
    for u in (last.u, beyond):
        guilty = singular_terms(rest.system).vanishing(u[: rest.system.n], rest.vector(u[-1]))
        if guilty:
            return replace(why, what=f"{why.what}; {', '.join(guilty)}, which vanishes or is negative there")
    return why
