"""Search for equilibria: damped Newton's method from many states at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hbbogie.equilibria.rest import Rest

Array = NDArray[np.float64]
SLICES = (0.471, 0.013, 0.987, 0.229, 0.743, 0.117, 0.871)  # of an interval, where starts at rest are made
ITERATIONS = 60
SHORTEST = 1 / 512  # share of a Newton step below which a start is given up
OWN = 0.03  # least share of the largest scale that one equilibrium has
NOTHING = 1e-9  # share of its first scale up to which a coordinate is zero
DONE = 1e-11  # largest scaled residual of a root
POLISH = 3  # Newton steps made after that
RELAXING, LONGER = 40, 1.6  # implicit Euler steps in time towards an equilibrium, each so much longer than the last
WIDE, NEAR = (-3.0, 8.0), (-2.5, 0.7)  # decades of random states about what is known of scales: nothing, and something


@dataclass(frozen=True, eq=False)
class Box:
    """Where equilibria are looked for.

    Attributes
    ----------
    low, high : ndarray, shape (m + 1,)
        Declared bounds of the coordinates, and the interval of the parameter.
    scale : ndarray, shape (m + 1,)
        Typical size of each unknown.
    """

    low: Array
    high: Array
    scale: Array

    @staticmethod
    def of(rest: Rest, interval: tuple[float, float]) -> Box:
        """Return the box of a system over an interval of the parameter, with scales from what is declared."""
        free = [np.full(rest.level.k, s * np.inf) for s in (-1, 1)]
        low, high = (
            np.concatenate([[c.bounds[i] for c in rest.system.coordinates], free[i], [interval[i]]]) for i in (0, 1)
        )
        sizes = [max((abs(b) for b in c.bounds if np.isfinite(b) and b), default=1.0) for c in rest.system.coordinates]
        return Box(low, high, np.concatenate([sizes, np.ones(rest.level.k), [interval[1] - interval[0]]]))

    def seen(self, rest: Rest, roots: Array) -> Box:
        """Return the box with the scales of states that were found; a coordinate that is always zero keeps its own."""
        n, scale = rest.system.n, self.scale.copy()
        largest = np.abs(roots[:, :n]).max(axis=0, initial=0.0)
        declared = np.isfinite(self.low[:n]) & np.isfinite(self.high[:n])
        found = largest > NOTHING * scale[:n]
        scale[:n] = np.where(declared, np.maximum(scale[:n], largest), np.where(found, largest, scale[:n]))
        scale[:n] = np.where(rest.reach, np.minimum(scale[:n], rest.reach), scale[:n])
        return Box(self.low, self.high, scale)

    def about(self, rest: Rest, u: Array) -> Box:
        """Return the box with the scales of one equilibrium: others may be far larger."""
        n, scale = rest.system.n, self.scale.copy()
        declared = np.isfinite(self.low[:n]) & np.isfinite(self.high[:n])
        own = np.maximum(np.abs(u[:n]), OWN * scale[:n])
        scale[:n] = np.where(declared | (rest.reach > 0), scale[:n], np.minimum(scale[:n], own))
        return Box(self.low, self.high, scale)

    def holds(self, u: Array) -> NDArray[np.bool_]:
        """Tell whether points, shape (N, m + 1), lie in the box, its faces included."""
        room = 1e-9 * self.scale
        return np.asarray(((u >= self.low - room) & (u <= self.high + room)).all(axis=1))


def newton(
    rest: Rest, u: Array, normals: Array, box: Box, free: NDArray[np.bool_] | None = None
) -> tuple[Array, NDArray[np.bool_]]:
    """Damped Newton's method from many starts, each in the plane through it across its normal.

    Parameters
    ----------
    rest : Rest
    u : ndarray, shape (N, m + 1)
        The starts.
    normals : ndarray, shape (N, m + 1), scaled unknowns
        The last unit vector looks at one value of the parameter.
    box : Box
        Whose faces are not crossed.
    free : ndarray of bool, shape (N,), optional
        Which of them take the shortest steps instead, in any direction: they end on short curves too.

    Returns
    -------
    u : ndarray, shape (N, m + 1)
    found : ndarray of bool, shape (N,)
        Which of them are roots.
    """
    base, scale = u, box.scale
    with np.errstate(all="ignore"):
        G, J, rows, error = _at(rest, u, scale)
        step = _steps(G, J, rows, normals, (u - base) / scale, scale, free)
        share, alive, done = np.ones(len(u)), np.isfinite(error), error == 0
        polished = np.zeros(len(u), dtype=int)
        for _ in range(ITERATIONS):
            busy = alive & ~done
            if not busy.any():
                break
            trial = np.where(busy[:, None], u + share[:, None] * scale * step, u)
            trial = np.clip(trial, box.low, box.high)
            G, J, new_rows, new = _at(rest, trial, scale)
            before = np.abs(G / rows).max(axis=1)  # in the rows of the step: a fair comparison
            met = error <= DONE
            good = busy & np.isfinite(new) & ((before < error) | (met & (before <= 10 * error)))
            moved = np.abs(trial - u)
            u = np.where(good[:, None], trial, u)
            rows = np.where(good[:, None], new_rows, rows)
            if good.any():
                fresh = _steps(G, J, rows, normals, (u - base) / scale, scale, free)
                step = np.where(good[:, None], fresh, step)
            small = (moved <= 1e-9 * np.maximum(np.abs(u), 1e-3 * scale)).all(axis=1)
            error = np.where(good, new, error)
            polished += busy & met  # a few more steps lead to round-off
            done |= busy & (error <= DONE) & ((good & small) | (error == 0) | (met & ~good) | (polished >= POLISH))
            share = np.where(good, np.minimum(1.0, 2 * share), share / 2)
            alive &= share >= SHORTEST
    return u, (done | (error <= DONE)) & np.isfinite(u).all(axis=1)


def _at(rest: Rest, u: Array, scale: Array) -> tuple[Array, Array, Array, Array]:
    """Return the equations, their derivatives, the sizes of the equations and the largest scaled residual."""
    G, J = rest.evaluate(u)
    rows = rest.rows(J, np.maximum(scale, np.abs(u)))
    error = np.where(np.isfinite(J).all(axis=(1, 2)), np.abs(G / rows).max(axis=1), np.inf)
    return G, J, rows, np.where(np.isnan(error), np.inf, error)


def _steps(
    G: Array,
    J: Array,
    rows: Array,
    normals: Array,
    away: Array,
    scale: Array,
    free: NDArray[np.bool_] | None = None,
) -> Array:
    """Return the scaled Newton steps; of free starts without their part along the curve of solutions."""
    N, m = G.shape
    matrix, right = np.empty((N, m + 1, m + 1)), np.zeros((N, m + 1, 2))
    matrix[:, :m], matrix[:, m] = J / rows[:, :, None] * scale, normals
    right[:, :m, 0], right[:, m, 0], right[:, m, 1] = -G / rows, -(normals * away).sum(axis=1), 1.0
    lost = ~(np.isfinite(matrix).all(axis=(1, 2)) & np.isfinite(right).all(axis=(1, 2)))
    matrix[lost], right[lost] = np.eye(m + 1), 0.0
    try:
        steps = np.linalg.solve(matrix, right)
    except np.linalg.LinAlgError:  # singular somewhere: the shortest steps
        steps = np.linalg.pinv(matrix, rcond=1e-12) @ right
    step, along = steps[:, :, 0], steps[:, :, 1]
    if free is None:
        return np.asarray(step)
    share = (step * along).sum(axis=1) / np.maximum((along**2).sum(axis=1), 1e-300)
    return np.asarray(step - np.where(free, share, 0.0)[:, None] * along)


def relaxed(rest: Rest, u: Array, scale: Array) -> Array:
    """Return where states move in time at a fixed parameter, by implicit Euler steps that become longer and longer.

    They end in Newton steps near an equilibrium; a second-order coordinate follows its damping, and its mass as if it
    were one.
    """
    m, n = rest.m, rest.system.n
    with np.errstate(all="ignore"):
        G, J, rows, _ = _at(rest, u, scale)
        _, D, M = rest.pencil(u)
        rates = np.zeros((len(u), m, m + 1))
        rates[:, :n, :n] = D + M
        dt = 1 / np.nanmax(rows[:, :n] / np.maximum(np.abs(D + M).max(axis=2) * scale[:n], 1e-300), axis=1)
        normals = np.tile(np.eye(m + 1)[-1], (len(u), 1))
        for _ in range(RELAXING):
            whole = J + rates / dt[:, None, None]
            step = _steps(G, whole, rest.rows(whole, scale), normals, 0 * u, scale)
            u = np.where(np.isfinite(step).all(axis=1, keepdims=True), u + scale * step, u)
            G, J, _, _ = _at(rest, u, scale)
            dt = LONGER * dt
    return u


def from_rest(rest: Rest, box: Box, start: Array, count: int) -> tuple[Array, Array]:
    """Return starts at a state, at several values of the parameter, and their normals."""
    shares = np.array(SLICES[:count])
    u = np.zeros((len(shares), len(box.scale)))
    u[:, : rest.system.n] = start
    u[:, -1] = box.low[-1] + shares * (box.high[-1] - box.low[-1])
    return u, np.tile(np.eye(len(box.scale))[-1], (len(u), 1))


def at_random(
    rest: Rest, box: Box, count: int, decades: tuple[float, float], seed: int
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return random starts, their normals, and which are free: every other one.

    Half of them in the box of bounds where there are two, all in one turn of angles, else log-uniform in the scale of
    each coordinate, of both signs where no bound forbids it: bounds may be far wider than what lies between them.
    """
    rng, n, m = np.random.default_rng(seed), rest.system.n, len(box.scale)
    low, high, scale = box.low[:n], box.high[:n], box.scale[:n]
    common = rng.uniform(*decades, (count, 1))
    q = scale * 10.0 ** (common + rng.uniform(-1, 1, (count, n))) * rng.choice([-1.0, 1.0], (count, n))
    q = np.where(np.isfinite(low), low + np.abs(q), np.where(np.isfinite(high), high - np.abs(q), q))
    both = np.isfinite(low) & np.isfinite(high) & (np.arange(count) % 4 < 2)[:, None]
    inside = rng.uniform(size=(count, n))
    q = np.clip(np.where(both, np.where(both, low, 0.0) + inside * np.where(both, high - low, 0.0), q), low, high)
    q = np.where(rest.reach, rest.reach * (2 * inside - 1), q)
    u = np.zeros((count, m))
    u[:, :n] = q
    strata = (rng.permutation(count) + rng.uniform(size=count)) / count
    u[:, -1] = box.low[-1] + strata * (box.high[-1] - box.low[-1])
    return u, np.tile(np.eye(m)[-1], (count, 1)), np.arange(count) % 2 == 0
