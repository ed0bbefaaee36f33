"""Whether a cycle agrees with its sequence, by durations and depths at all surfaces, and rules to correct it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hbbogie.exact.closing import Closing, Linearised
from hbbogie.exact.model import SwitchedLinear
from hbbogie.exact.sequence import Sequence
from hbbogie.exponential import exponentials

Array = NDArray[np.float64]

CLOSE = 0.03  # scaled depth below which the minimum is computed exactly
ALLOWED = 1e-8  # scaled depth on the wrong side of a surface, and scaled negative duration, that count as round-off


def samples(at: Linearised, of: NDArray[np.int_]) -> Array:
    """Return states at eighths of each phase, shape (B, S, N, 9)."""
    E8, E4, E2, _ = at.E
    B, S, N = at.nodes[:, :-1].shape
    x = np.empty((B, S, N, 9))
    x[..., 0], x[..., 8] = at.nodes[:, :-1], at.nodes[:, 1:]
    x[..., 4:5] = E2 @ x[..., 0:1]
    x[..., 2:8:4] = E4 @ x[..., 0:8:4]
    x[..., 1:9:2] = E8 @ x[..., 0:8:2]
    return x


@dataclass(frozen=True, eq=False)
class Depths:
    """The smallest depth of the motion on the proper side of each surface, for each phase.

    Attributes
    ----------
    least : ndarray, shape (B, S, K)
        Scaled; negative where the motion is on the wrong side.
    share : ndarray, shape (B, S, K)
        Its place, as a share of the phase.
    """

    least: Array
    share: Array


def depths(closing: Closing, y: Array, at: Linearised) -> Depths:
    """Return the smallest depths, from samples and from cubics through depths and rates at neighbouring samples."""
    n, sequence = closing.n, closing.sequence
    x, of = samples(at, sequence.of), sequence.of
    sign = 2 * sequence.states[of] - 1
    rows = at.rows[:, of] * sign[..., None]
    h = y[:, n : n + sequence.S, None, None] / 8
    depth, rate = rows @ x, (rows @ at.A[:, of]) @ x * h
    g0, g1, d0, d1 = depth[..., :-1], depth[..., 1:], rate[..., :-1], rate[..., 1:]
    # the cubic g0 + d0 s + b s^2 + a s^3 has a minimum inside if it falls at its beginning and rises at its end
    a, b = 2 * (g0 - g1) + d0 + d1, 3 * (g1 - g0) - 2 * d0 - d1
    turning = (d0 < 0) & (d1 > 0)
    root = np.sqrt(np.maximum(b * b - 3 * a * d0, 0.0))
    s = np.where(turning, -d0 / np.where(turning, b + root, 1.0), 0.0)
    inside = np.where(turning, g0 + s * (d0 + s * (b + s * a)), np.inf)
    close = np.nonzero(inside < CLOSE)
    if len(close[0]):
        inside[close], s[close] = _refined(closing, at, x, rows, y, close, s[close])
    every = np.concatenate([depth, inside], axis=-1)
    where = np.concatenate([np.broadcast_to(np.arange(9.0), depth.shape), np.arange(8) + s], axis=-1) / 8
    k = every.argmin(axis=-1)[..., None]
    return Depths(np.take_along_axis(every, k, -1)[..., 0], np.take_along_axis(where, k, -1)[..., 0])


def _refined(
    closing: Closing, at: Linearised, x: Array, rows: Array, y: Array, close: tuple[NDArray[np.int_], ...], s: Array
) -> tuple[Array, Array]:
    """Return exact smallest depths and their places, as shares of an eighth of a phase, from estimates s."""
    b, i, k, j = close
    u = closing.sequence.of[i]
    A, row, start = at.A[b, u], rows[b, i, k, None], x[b, i, :, j][..., None]
    eighth, of = y[b, closing.n + i] / 8, np.arange(len(b))
    t = s * eighth
    for last in (False, False, True):
        here = exponentials(A[None], of, t[None])[-1][0] @ start
        if last:
            break
        rate = A @ here
        first, second = (row @ rate)[:, 0, 0], (row @ A @ rate)[:, 0, 0]
        t = np.clip(t - first / np.where(second > 0, second, np.inf), 0.0, eighth)
    return (row @ here)[:, 0, 0], t / eighth


def consistent(closing: Closing, y: Array, at: Linearised, found: Depths) -> NDArray[np.bool_]:
    """Return which of the cycles agree with their sequence, shape (B,); of large ones round-off is larger."""
    h, size = y[:, closing.n : closing.n + closing.sequence.S], np.maximum(1.0, np.abs(y[:, : closing.n]).max(axis=1))
    return np.asarray((h > -ALLOWED).all(axis=1) & (found.least.min(axis=(1, 2)) > -ALLOWED * size))


def repaired(
    sequence: Sequence, y: Array, n: int, model: SwitchedLinear, at: Linearised, found: Depths, b: int = 0
) -> tuple[Sequence, Array] | None:
    """Return a better sequence and guess for cycle b, by one local rule; None if no rule applies.

    A contact with a negative duration is removed. Crossings in the wrong order are exchanged. If a surface is crossed
    inside a phase, a contact is inserted.
    """
    S = sequence.S
    h = y[n : n + S]
    i = int(np.argmin(h))
    if h[i] < -ALLOWED:
        if S <= 2:
            return None
        if i in (0, S - 1):
            to = 1 if i == S - 1 else S - 1
            to = to if S == 3 else (i + S // 2) % S
            y = np.concatenate([at.nodes[b, to, :n], np.roll(h, -to), y[n + S :]])
            sequence, i = sequence.rotated(to, model), (i - to) % S
            if i in (0, S - 1):
                return None
        if i in sequence.touching:
            return sequence.without(i), joined(y, n + i - 1)
        y = y.copy()
        y[n + i - 1 : n + i + 2 : 2] += y[n + i]
        y[n + i] *= -1
        return sequence.swapped(i), y
    phase, k = (int(j) for j in np.unravel_index(np.argmin(found.least[b]), found.least[b].shape))
    share, depth, u = float(found.share[b, phase, k]), float(found.least[b, phase, k]), sequence.of[phase]
    x = at.nodes[b, phase] if share < 0.5 else at.nodes[b, phase + 1]
    curvature = abs(float(at.rows[b, u, k] @ at.A[b, u] @ at.A[b, u] @ x))
    half = float(np.clip(np.sqrt(2 * abs(depth) / max(curvature, 1e-12)), 0.01 * h[phase], 0.2 * h[phase]))
    before = max(share * h[phase] - half, 0.02 * h[phase])
    after = max(h[phase] - before - 2 * half, 0.02 * h[phase])
    return sequence.touched(phase, k), np.concatenate([y[: n + phase], [before, 2 * half, after], y[n + phase + 1 :]])


def joined(y: Array, i: int) -> Array:
    """Return the unknowns with the three durations from place i on merged into one."""
    return np.concatenate([y[:i], [y[i : i + 3].sum()], y[i + 3 :]])
