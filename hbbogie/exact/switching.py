"""From a pitchfork or a period doubling to the branch that begins there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hbbogie.exact.closing import Closing
from hbbogie.exact.points import Point, correct
from hbbogie.exact.sequence import Sequence
from hbbogie.exact.touching import consistent, depths

STEPS = (0.02, 0.005, 0.1)  # distances from the special point, in scaled unknowns, tried in turn


def onward(point: Point) -> Point | None:
    """Return a cycle on the branch that begins at a point with a multiplier -1; None where none is found.

    Its phases are those of a whole period where the point has those of half a period (the symmetry breaks), and else
    those of two periods. In these unknowns two branches cross at the point: their tangents span the null space of the
    equations, and the step is made in it at a right angle to the one that is known.
    """
    closing, y, S, n = point.closing, point.y, point.closing.sequence.S, point.closing.n
    twice = replace(closing, sequence=_twice(closing))

    def doubled(v: np.ndarray) -> np.ndarray:
        return np.concatenate([v[: n + S], v[n:]])

    start, known = doubled(y), doubled(point.tangent)
    null = np.linalg.svd(twice.linearise(start[None]).J[0])[2][-2:]
    along = null @ known
    normal = np.array([-along[1], along[0]]) @ null
    normal /= np.linalg.norm(normal)
    for step in STEPS:
        found, _ = correct(twice, start + step * normal, normal)
        if found is not None:
            there = depths(twice, found.y[None], found.at)
            if consistent(twice, found.y[None], found.at, there)[0]:
                return found
    return None


def _twice(closing: Closing) -> Sequence:
    """Return the sequence passed twice, the second time mirrored where it makes up half a period."""
    sequence, model = closing.sequence, closing.model
    sides, events = sequence.sides, sequence.events
    if sequence.sigma < 0:
        assert model.mirror is not None
        sides, events = tuple(map(model.mirrored, sides)), tuple(int(model.mirror[e]) for e in events)
    return Sequence(sequence.sides + sides, sequence.events + events, 1)
