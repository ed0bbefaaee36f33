"""Points of a branch of exact cycles, and Newton's method to find one."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hbbogie.brief import brief
from hbbogie.exact.closing import Closing, Linearised

Array = NDArray[np.float64]

FINAL = 1e-9  # size of the last correction of a scaled unknown
ITERATIONS = 8
FARTHEST = 0.5  # longest correction of a scaled unknown


@dataclass(frozen=True, eq=False)
class Point:
    """A point of a branch: unknowns, tangent, both of shape (m + 1,), and the equations there.

    ``along`` is the direction of the parameter. At a grazing the tangent does not show it, because the duration of the
    new contact grows like the square root of the other changes.
    """

    closing: Closing
    y: Array
    tangent: Array
    at: Linearised
    kind: str = ""
    along: float | None = None

    __repr__ = brief

    @property
    def direction(self) -> float:
        """Positive if the parameter rises along the walk, negative if it falls, 0 if that is not known."""
        return float(self.tangent[-1]) if self.along is None else self.along

    def turned(self) -> Point:
        """Return the point with the branch run through in the other direction."""
        return replace(self, tangent=-self.tangent, along=None if self.along is None else -self.along)

    @property
    def value(self) -> float:
        """Value of the parameter [its unit]."""
        return float(self.y[-1] * self.closing.frame.parameter[0])

    @property
    def omega(self) -> float:
        """Frequency [rad/s]."""
        S, n, sigma = self.closing.sequence.S, self.closing.n, self.closing.sequence.sigma
        return float((np.pi if sigma < 0 else 2 * np.pi) / self.y[n : n + S].sum() * self.closing.frame.rate[0])


def correct(closing: Closing, y: Array, normal: Array) -> tuple[Point | None, float]:
    """Return the point of the branch in the plane through y normal to ``normal``, and its distance from y."""
    start, first, m = y, 0.0, closing.m
    held = np.flatnonzero(normal)
    held = held if len(held) == 1 else held[:0]  # an unknown that is held must keep its value exactly
    matrix, right = np.empty((m + 1, m + 1)), np.zeros((m + 1, 2))
    right[m, 1] = 1.0
    for _ in range(ITERATIONS):
        with np.errstate(over="ignore", invalid="ignore"):  # far away; the step is then no number
            at = closing.linearise(y[None])
        matrix[:m], matrix[m] = at.J[0], normal
        right[:m, 0], right[m, 0] = -at.F[0], -(normal @ (y - start))
        try:
            step, tangent = np.linalg.solve(matrix, right).T
        except np.linalg.LinAlgError:
            return None, first
        step[held] = 0.0
        size = float(np.abs(step).max())
        if size <= FINAL:  # the error after a correction is of the order of its square
            return Point(closing, y + step, tangent / np.linalg.norm(tangent), at), first
        first = first or size
        if not size <= FARTHEST:
            return None, first
        y = y + step
    return None, first


def unit(length: int, place: int) -> Array:
    """Return a unit vector."""
    e = np.zeros(length)
    e[place] = 1.0
    return e
