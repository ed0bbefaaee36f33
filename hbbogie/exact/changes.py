"""Changes of the sequence of contacts along a branch: grazings, and crossings that exchange their order."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hbbogie.exact.closing import Closing
from hbbogie.exact.points import Point, correct, unit
from hbbogie.exact.touching import ALLOWED, Depths, consistent, depths, joined, repaired

Array = NDArray[np.float64]

REPAIRS = 6  # largest number of corrections of a sequence whose change is not located


def rotated(point: Point, to: int | None = None) -> Point:
    """Return the same cycle, beginning with its longest phase or with the given phase."""
    closing, S, n = point.closing, point.closing.sequence.S, point.closing.n
    h = point.y[n : n + S]
    if to is None:
        to = 0 if h[0] >= 0.5 * h.max() else int(np.argmax(h))
    if to == 0:
        return point
    y, t = point.y.copy(), point.tangent.copy()
    y[:n], t[:n] = point.at.nodes[0, to, :n], (point.at.moved[to, 0] @ point.tangent)[:n]
    y[n : n + S], t[n : n + S] = np.roll(y[n : n + S], -to), np.roll(t[n : n + S], -to)
    closing = replace(closing, sequence=closing.sequence.rotated(to, closing.model))
    return Point(closing, y, t / np.linalg.norm(t), closing.linearise(y[None]), point.kind, point.along)


def across(here: Point, there: Point, found: Depths) -> Point | None:
    """Return the point at which the sequence changes, with the new sequence; None if it is not found.

    If a contact begins or is lost, this is the grazing. If two crossings exchange their order, it is the point beyond.
    """
    n, S = there.closing.n, there.closing.sequence.S
    h = there.y[n : n + S]
    i = int(np.argmin(h))
    if h[i] < -ALLOWED:
        if i in (0, S - 1) and S > 2:
            to = int(np.argmax(h))
            if to == 0:
                to = 1 if i == S - 1 else 0
            turned, ahead = rotated(here, to or S // 2), rotated(there, to or S // 2)
            return across(turned, ahead, found)
        if i in there.closing.sequence.touching:
            return _lost(here, there, i)
        return _exchanged(there, i) if 0 < i < S - 1 else None  # at an end of few phases a step was too long
    least = found.least[0].min()
    phase, k = (int(j) for j in np.unravel_index(np.argmin(found.least[0]), found.least[0].shape))
    return _touched(here, there, phase, k, float(found.share[0, phase, k])) if least < -ALLOWED else None


def _lost(here: Point, there: Point, i: int) -> Point | None:
    """Return the grazing at which the contact of phase i is lost, in the sequence without it."""
    closing, n = there.closing, there.closing.n
    share = here.y[n + i] / (here.y[n + i] - there.y[n + i])
    y = here.y + share * (there.y - here.y)
    y[n + i] = 0.0
    point, _ = correct(closing, y, unit(len(y), n + i))
    if point is None or not sound(point):
        return None
    if closing.sequence.S == 2:
        return replace(point, kind="lost", along=here.direction)
    new = replace(closing, sequence=closing.sequence.without(i))
    y, last = (joined(q.y, n + i - 1) for q in (point, here))
    return _begun(new, y, y - last)


def _exchanged(there: Point, i: int) -> Point | None:
    """Return the point with the crossings at the two ends of phase i exchanged."""
    closing, n = there.closing, there.closing.n
    new = replace(closing, sequence=closing.sequence.swapped(i))
    y, t = there.y.copy(), there.tangent.copy()
    for a in (y, t):
        a[n + i - 1] += a[n + i]
        a[n + i + 1] += a[n + i]
        a[n + i] *= -1
    point, _ = correct(new, y, t)
    if point is None or not sound(point):
        return None
    return replace(point, tangent=point.tangent * np.sign(point.tangent @ t))


def _touched(here: Point, there: Point, i: int, k: int, share: float) -> Point | None:
    """Return the grazing at which surface k is touched in phase i, in the sequence with the new contact."""
    closing, n = there.closing, there.closing.n
    new = replace(closing, sequence=closing.sequence.touched(i, k))
    h = there.y[n + i]
    y = np.concatenate([there.y[: n + i], [share * h, 0.0, (1 - share) * h], there.y[n + i + 1 :]])
    point, _ = correct(new, y, unit(len(y), n + i + 1))
    if point is None or not sound(point):
        return None
    before = _begun(closing, joined(point.y, n + i), there.y - here.y)
    if before is None or not 0 <= (before.y - here.y) @ (there.y - here.y) <= np.sum((there.y - here.y) ** 2):
        return None
    tangent = point.tangent * np.sign(point.tangent[n + i + 1])
    return replace(point, tangent=tangent, kind="grazing", along=before.direction)


def _begun(closing: Closing, y: Array, secant: Array) -> Point | None:
    """Return a point at a grazing, its tangent in the direction of a secant."""
    point, _ = correct(closing, y, secant / np.linalg.norm(secant))
    if point is None:
        return None
    return replace(point, tangent=point.tangent * np.sign(point.tangent @ secant), kind="grazing")


def beyond(there: Point, found: Depths) -> Point | None:
    """Return the cycle at the same parameter in a sequence that agrees with the motion, by local rules."""
    point = there
    for _ in range(REPAIRS):
        changed = repaired(point.closing.sequence, point.y, point.closing.n, point.closing.model, point.at, found)
        if changed is None:
            return None
        closing, y = replace(point.closing, sequence=changed[0]), changed[1]
        new, _ = correct(closing, y, unit(len(y), len(y) - 1))
        if new is None:
            return None
        point, found = new, depths(closing, new.y[None], new.at)
        if consistent(closing, point.y[None], point.at, found)[0]:
            turn = np.sign(point.tangent[-1] * there.tangent[-1])
            return replace(point, tangent=point.tangent * turn, kind="not located")
    return None


def sound(point: Point) -> bool:
    """Return whether the motion of a point agrees with its sequence."""
    y = point.y[None]
    return bool(consistent(point.closing, y, point.at, depths(point.closing, y, point.at))[0])
