"""Measured laws without kinks: a cubic spline through points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, CubicSpline, PPoly, make_smoothing_spline

from hbbogie.brief import brief
from hbbogie.errors import ModelError, as_number
from hbbogie.model.ramps import Scalar
from hbbogie.model.scalars import check_list

FEWEST = 5  # points of a spline


@dataclass(frozen=True, eq=False)
class Spline:
    """A measured law without kinks: a natural cubic spline through points, its end lines go on beyond the table.

    It is twice differentiable, with exact derivatives. `Tabulated` takes straight lines between the points instead,
    whose kinks are located.

    Parameters
    ----------
    u : sequence of float, unit of the argument
        Increasing abscissae, at least five.
    forces : sequence of float, unit of force
        The force at each.
    smoothing : float, unit of the argument cubed
        Weight of the integral of the squared second derivative against the sum of the squared distances from the
        points. With 0 the spline passes through them. Where a table has a step, as from the tread to the flange of a
        wheel, it overshoots there; a weight, or points farther apart, lessen that.

    Raises
    ------
    ModelError
        When the points are not acceptable.

    Examples
    --------
    >>> law = Spline([-2.0, -1.0, 0.0, 1.0, 2.0], [-4.0, -1.0, 0.0, 1.0, 4.0])
    >>> float(law.force(1.0)), round(float(law.force(3.0) - law.force(2.0)), 9)
    (1.0, 3.5)
    """

    u: Sequence[float]
    forces: Sequence[float]
    smoothing: float = 0.0

    __repr__ = brief

    def __post_init__(self) -> None:
        for name in ("u", "forces"):
            check_list(f"Spline: {name}", getattr(self, name))
        u, forces, weight = (np.array([as_number(x) for x in xs]) for xs in (self.u, self.forces, [self.smoothing]))
        if len(u) != len(forces) or len(u) < FEWEST or not np.isfinite([*u, *forces]).all():
            raise ModelError(
                f"Spline: got {len(u)} abscissae and {len(forces)} forces; give as many of each, at least {FEWEST}, "
                "and finite numbers."
            )
        if (np.diff(u) <= 0).any():
            raise ModelError(f"Spline: the abscissae must increase, got {list(self.u)}; sort the table.")
        if not (np.isfinite(weight) & (weight >= 0)).all():
            raise ModelError(f"Spline: smoothing={self.smoothing!r}; give a number from 0.")

    def force(self, u: Scalar) -> Scalar:
        """Return the force at the argument u."""
        knots, c = self._pieces()
        x, inside = ca.SX(u), ca.fmin(ca.fmax(ca.SX(u), knots[0]), knots[-1])
        inner = ca.DM(knots[1:-1])
        start, *parts = (_piecewise(inside, inner, values) for values in (knots[:-1], *c))
        d = inside - start
        value = parts[0]
        for part in parts[1:]:
            value = value * d + part
        slopes = c[2, 0], float(np.polyval(np.polyder(c[:, -1]), knots[-1] - knots[-2]))
        value += slopes[0] * ca.fmin(x - knots[0], 0) + slopes[1] * ca.fmax(x - knots[-1], 0)
        return value if isinstance(u, ca.SX) else ca.DM(value)

    def _pieces(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the knots, shape (m + 1,), and the cubics, shape (4, m), the highest power first."""
        u, forces = (np.array([as_number(x) for x in xs]) for xs in (self.u, self.forces))
        if not self.smoothing:
            spline = CubicSpline(u, forces, bc_type="natural")
            return spline.x, spline.c
        smooth: BSpline = make_smoothing_spline(u, forces, lam=float(self.smoothing))
        whole = PPoly.from_spline(smooth)
        kept = np.diff(whole.x) > 0
        return np.append(whole.x[:-1][kept], whole.x[-1]), whole.c[:, kept]


def _piecewise(u: ca.SX, inner: ca.DM, values: NDArray[np.float64]) -> ca.SX:
    """Return the value of the interval in which u lies."""
    return ca.pw_const(u, ca.SX(inner), ca.SX(ca.DM(values)))
