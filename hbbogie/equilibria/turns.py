"""Folds and branch points of branches of equilibria, and the branches that cross there."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hbbogie.equilibria.curve import RestBranch, RestCurve, Turn, scaled_step
from hbbogie.equilibria.rest import Rest
from hbbogie.equilibria.search import Box
from hbbogie.solving.arclength import correct, located
from hbbogie.solving.curve import Point

Array = NDArray[np.float64]
OFF = (0.01, 0.03, 0.003, 0.1)  # distances at which a crossing branch is looked for
SAME = 1e-4  # distance up to which a fold and a branch point are one
DEEPEST = 8  # bisections in search of a branch point


def turns(rest: Rest, box: Box, branch: RestBranch) -> tuple[Turn, ...]:
    """Return the folds and branch points of a branch."""
    curve = RestCurve(rest, box, branch.scale)
    tangents = branch.t / branch.scale
    points = [Point(u, t, np.zeros(rest.m)) for u, t in zip(branch.u, tangents, strict=True)]
    _, J = rest.evaluate(branch.u)
    rows = rest.rows(J, np.maximum(curve.scale, np.abs(branch.u)))
    bordered = np.concatenate([J / rows[:, :, None] * curve.scale, (tangents * curve.weights)[:, None]], axis=1)
    bordered[~np.isfinite(bordered).all(axis=(1, 2))] = np.eye(rest.m + 1)
    signs = np.linalg.slogdet(bordered)[0]
    found = []
    for i in range(len(points) - 1):
        a, b = points[i], points[i + 1]
        forks = [_branch_point(curve, a, b, i, np.maximum(rows[i], rows[i + 1]))] if signs[i] * signs[i + 1] < 0 else []
        found += forks
        if a.tangent[-1] * b.tangent[-1] < 0:
            fold, _ = located(curve, a, b, lambda point: float(point.tangent[-1])) or (None, 0.0)
            near = np.inf if fold is None else min((_apart(curve, fold.u, f.u) for f in forks), default=np.inf)
            if fold is not None and near > SAME:
                found.append(Turn("fold", fold.u, i))
            elif not forks or forks[0].kind != "branch point":  # the extremum of a pitchfork is its branch point
                found.append(Turn("not located", (a.u + b.u) / 2, i, None, "the branch turns here, unexplained"))
    return tuple(found)


def _apart(curve: RestCurve, a: Array, b: Array) -> float:
    return float(np.linalg.norm((a - b) / curve.scale * curve.weights))


def _branch_point(curve: RestCurve, a: Point, b: Point, after: int, rows: Array, depth: int = 0) -> Turn:
    """Return the branch point between two points, by Newton's method on its own equations, bisecting until it lands."""
    scaled = curve.scale * np.where(curve.weights, 1.0, np.inf)
    guess = (a.u + b.u) / 2
    u = _newton_at_branch_point(curve, guess, rows)
    chord = (b.u - a.u) / scaled
    if u is not None:
        share = float(((u - a.u) / scaled) @ chord / (chord @ chord))
        off = np.linalg.norm((u - a.u) / scaled - share * chord)
        if -0.01 <= share <= 1.01 and off <= 0.3 * np.linalg.norm(chord):
            J = curve.rest.evaluate(u[None])[1][0] / rows[:, None] * curve.scale
            null = np.linalg.svd(J)[2][-2:]
            along = null @ (chord / np.linalg.norm(chord) * curve.weights)
            return Turn("branch point", u, after, null.T @ np.array([-along[1], along[0]]) / np.linalg.norm(along))
    if depth < DEEPEST:
        middle, _ = correct(curve, guess, chord / np.linalg.norm(chord))
        if middle is not None:
            tangent = middle.tangent * np.sign(middle.tangent @ chord)
            middle = replace(middle, tangent=tangent)
            signs = [_sign(curve, p) for p in (a, middle)]
            pair = (a, middle) if signs[0] * signs[1] < 0 else (middle, b)
            return _branch_point(curve, pair[0], pair[1], after, rows, depth + 1)
    return Turn("not located", guess, after, None, "the direction of the branch flips here, unexplained")


def _sign(curve: RestCurve, point: Point) -> float:
    J = curve.evaluate(point.u)[1]
    return float(np.linalg.slogdet(np.vstack([J, point.tangent * curve.weights]))[0])


def _newton_at_branch_point(curve: RestCurve, u: Array, rows: Array) -> Array | None:
    """Solve F + e w = 0, w' dF/du = 0, |w| = 1 for a branch point, its left null vector w and e = 0."""
    rest, m = curve.rest, curve.rest.m
    key = ("branch point", rest.place, rest.level.k)
    f = rest.system.once(key, lambda: _branch_point_equations(rest))
    _, J = (x[0] for x in rest.evaluate(u[None]))
    if not np.isfinite(J).all():
        return None
    x = np.concatenate([u, np.linalg.svd(J / rows[:, None] * curve.scale)[0][:, -1], [0.0]])
    size = np.concatenate([curve.scale, np.ones(m + 1)])
    level = rest.level
    for _ in range(20):
        G, dG = (out.full() for out in f(x, rest.p, rows, curve.scale, level.directions, level.rows, level.held))
        if not (np.isfinite(G).all() and np.isfinite(dG).all()):
            return None
        try:
            step = np.linalg.solve(dG * size, -G.ravel())
        except np.linalg.LinAlgError:
            return None
        x = x + size * step
        if np.abs(step).max() > 1e3:
            return None
        if np.abs(step).max() <= 1e-11:
            return x[: m + 1] if abs(x[-1]) <= 1e-9 else None
    return None


def _branch_point_equations(rest: Rest) -> ca.Function:
    n, k, m = rest.system.n, rest.level.k, rest.m
    x, p, rows, scale = (ca.SX.sym(s, c) for s, c in zip("xprs", (2 * m + 2, len(rest.p), m, m + 1), strict=True))
    directions, held_rows, held = ca.SX.sym("d", n, k), ca.SX.sym("h", k, n), ca.SX.sym("l", k)
    u, w, e = x[: m + 1], x[m + 1 : 2 * m + 1], x[2 * m + 1]
    shifted = ca.SX(p)
    shifted[rest.place] = u[m]
    r = rest.system.residual(u[:n], 0, 0, shifted) + ca.mtimes(directions, u[n:m])
    F = ca.vertcat(r, ca.mtimes(held_rows, u[:n]) - held) / rows
    turned = ca.gradient(ca.dot(w, F), u) * scale
    G = ca.vertcat(F + e * w, turned, ca.dot(w, w) - 1)
    out = [ca.densify(G), ca.densify(ca.jacobian(G, x))]
    return ca.Function("branch_point", [x, p, rows, scale, directions, held_rows, held], out)


def crossing(rest: Rest, box: Box, branch: RestBranch, turn: Turn) -> list[Array]:
    """Return equilibria beside a branch point that lie off the branch, on both sides of it."""
    curve = RestCurve(rest, box, branch.scale)
    found: list[Array] = []
    for side in (1.0, -1.0):
        for length in OFF:
            if turn.across is None:
                break
            guess = turn.u + scaled_step(curve, turn.across, side * length)
            point, _ = correct(curve, guess, turn.across * curve.weights)
            if point is not None and box.holds(point.u[None])[0] and not branch.passes(curve, point.u):
                found.append(point.u)
                break
    return found
