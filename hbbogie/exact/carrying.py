"""Designs without a fold, many together: the branches of one that was followed are carried over to the others.

Each cycle kept of the branch is solved for at the parameters of all designs at once, in the same sequence of contacts.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hbbogie.exact.closing import Closing, Linearised
from hbbogie.exact.folding import pulled_back
from hbbogie.exact.hopf import unstable_at
from hbbogie.exact.points import FARTHEST, FINAL, ITERATIONS, Point, correct, unit
from hbbogie.exact.touching import consistent, depths
from hbbogie.exact.walk import SHORT, Walk

Array = NDArray[np.float64]

ALIGNED = 0.9  # cosine of the angle between the tangents of neighbours, of a design's cycle and of the one carried over
BEGUN = 1e-2  # scaled duration of the first contact at which the direction of a branch is beyond round-off
SAME = 1e-8  # relative distance of the value where a branch begins from the Hopf point
CHECKED = 24  # values over the interval at which the equilibrium must have as many unstable modes as expected


@dataclass(frozen=True, eq=False)
class Stage:
    """A cycle of the branch that is carried over.

    Attributes
    ----------
    point : Point
        Its tangent in the direction in which the branch is followed.
    normal : ndarray, shape (m + 1,)
        Of the plane in which the cycle of another design is looked for.
    shows : bool
        Whether the tangent shows the direction of the parameter, which it does not at a grazing.
    """

    point: Point
    normal: Array
    shows: bool

    @cached_property
    def shift(self) -> Array:
        """Derivative of the unknowns in the logarithms of all parameters, shape (m + 1, number of parameters)."""
        closing, m = self.point.closing, self.point.closing.m
        held, one = self.normal == 1.0, np.zeros(m, dtype=int)
        y = np.where(held, np.maximum(self.point.y, SHORT), self.point.y)  # what follows divides by a duration
        many, there = replace(closing, p=closing.p[one], frame=closing.frame.of(one)), np.repeat(y[None], m, axis=0)
        at = many.linearise(there)
        slopes = pulled_back(many, there, at, np.eye(m)) * closing.p[0]
        slopes[:, closing.place] = 0.0
        matrix, right = np.vstack([at.J[0], self.normal]), np.vstack([-slopes, np.zeros(slopes.shape[1])])
        shift = np.linalg.lstsq(matrix, right, rcond=1e-12)[0]
        shift[held] = 0.0  # what is held keeps its value exactly
        return np.asarray(shift)

    def cycles(self, p: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Return the parameter's values at the cycles of D designs, and which are there and lead the same way."""
        closing, own = self.point.closing, self.point.closing.p[0]
        usable = (p * own > 0) & (np.arange(len(own)) != closing.place)
        y = self.point.y + np.log(np.where(usable, p, 1.0) / np.where(usable, own, 1.0)) @ self.shift.T
        frame = closing.frame.of(np.zeros(len(p), dtype=int))
        many = replace(closing, p=p, frame=frame)
        found = _corrected(many, y, self.normal)
        if found is None:
            return y[:, -1], np.zeros(len(p), dtype=bool)
        y, tangents, at, good = found
        good &= consistent(many, y, at, depths(many, y, at))
        tangents *= np.sign(tangents @ self.point.tangent)[:, None]
        good &= tangents @ self.point.tangent > ALIGNED
        if self.shows:
            good &= tangents[:, -1] * self.point.tangent[-1] > 0
        return y[:, -1] * frame.parameter, good


class Branches:
    """The branches from all Hopf points of a design, all of them above its first Hopf point.

    Parameters
    ----------
    walks : list of Walk
        The branches, in the order of their Hopf points, followed to their ends.
    window : (float, float), unit of the parameter
        Over which Hopf points were looked for.
    """

    def __init__(self, walks: list[Walk], window: tuple[float, float]):
        first = walks[0].points[0].closing
        self.model, self.place, self.rest = first.model, first.place, first.sequence.states[0]
        self.window = window
        self.stages = [_stages_of(walks[0]), *(_stages_of(walk, begins=True) for walk in walks[1:])]
        hopf = [walk.points[0].value for walk in walks]
        between = np.convolve([window[0], *hopf, window[1]], [0.5, 0.5], "valid")
        self.pattern = unstable_at(self.model, first.p, self.place, self.rest, between[None])[0]

    @property
    def usable(self) -> bool:
        """Whether cycles on all branches tell how they run."""
        return all(self.stages)

    def above(self, p: Array, hopf: Array) -> NDArray[np.bool_]:
        """Return which of D designs have such branches, too: the first all along, the others where they begin.

        Parameters
        ----------
        p : ndarray, shape (D, number of parameters)
        hopf : ndarray, shape (D,), unit of the parameter
            First Hopf points.
        """
        low, high = self.window
        room, begins = SAME * np.abs(hopf), np.full((len(p), len(self.stages)), np.nan)
        alive = np.arange(len(p))
        for k, stages in enumerate(self.stages):
            for j, stage in enumerate(stages):
                values, good = stage.cycles(p[alive])
                first = hopf[alive] - room[alive] * (k == 0 and j < 2)  # a branch is flat where it begins
                good &= (values > first) & (values >= low) & (values <= high)
                if j == 0:
                    begins[alive, k] = values
                    good &= np.abs(values - hopf[alive]) <= room[alive] if k == 0 else True
                alive = alive[good]
                if not len(alive):
                    return np.zeros(len(p), dtype=bool)
        values = np.tile(np.linspace(low, high, CHECKED + 2)[1:-1], (len(alive), 1))
        expected = self.pattern[(values[..., None] > begins[alive, None]).sum(axis=-1)]
        counted = unstable_at(self.model, p[alive], self.place, self.rest, values)
        return np.isin(np.arange(len(p)), alive[(counted == expected).all(axis=1)])


def _stages_of(walk: Walk, begins: bool = False) -> list[Stage]:
    """Return the cycles of a branch that tell how it runs, or only how it begins; none where they do not."""
    points, first = walk.points, walk.points[0]
    normal = unit(len(first.y), len(first.y) - 2)
    near, _ = correct(first.closing, first.y + BEGUN * normal, normal)
    if near is None or any(q.kind in ("fold not located", "not located") for q in points):
        return []
    kept = [Stage(first, normal, False), Stage(near.turned() if near.tangent[-2] < 0 else near, normal, True)]
    for before, point in pairwise(points) if not begins else []:
        last, zero, n = kept[-1].point, _vanishing(point), len(point.y)
        # where crossings have just exchanged their order, those of another design may not have, so the next one counts
        alone = point.closing is not last.closing or point.tangent @ last.tangent < ALIGNED
        if point.kind == "end":
            kept.append(Stage(point, unit(n, n - 1), True))
        elif zero is not None:
            kept.append(Stage(point, unit(n, zero), False))
        elif not point.kind and (point is points[-1] or (alone and point.closing is before.closing)):
            kept.append(Stage(point, point.tangent, True))
    return kept


def _vanishing(point: Point) -> int | None:
    """Return the place of the duration that is zero at a grazing; None elsewhere."""
    n = point.closing.n
    return next((n + i for i in point.closing.sequence.touching if point.y[n + i] == 0.0), None)


def _corrected(closing: Closing, y: Array, normal: Array) -> tuple[Array, Array, Linearised, NDArray[np.bool_]] | None:
    """Return unknowns, tangents and equations in the planes through the guesses, and which have converged."""
    held = np.flatnonzero(normal)
    held = held if len(held) == 1 else held[:0]
    start, m = y, closing.m
    size = np.maximum(1.0, np.abs(y).max(axis=1))  # of large motions what is small is relative to them
    good = np.ones(len(y), dtype=bool)
    matrix, right = np.empty((len(y), m + 1, m + 1)), np.zeros((len(y), m + 1, 2))
    right[:, m, 1] = 1.0
    for _ in range(ITERATIONS):
        at = closing.linearise(y)
        matrix[:, :m], matrix[:, m] = at.J, normal
        right[:, :m, 0], right[:, m, 0] = -at.F, (start - y) @ normal
        try:
            solved = np.linalg.solve(matrix, right)
        except np.linalg.LinAlgError:
            return None
        step, tangents = solved[..., 0], solved[..., 1]
        step[:, held] = 0.0
        change = np.abs(step).max(axis=1) / size
        good &= change <= FARTHEST
        y = np.where(good[:, None], y + step, start)
        if (change[good] <= FINAL).all():
            break
    tangents = tangents / np.linalg.norm(tangents, axis=1)[:, None]
    return y, tangents, at, good & (change <= FINAL)
