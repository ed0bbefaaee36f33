"""Piecewise-linear laws as straight line plus ramps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

Scalar = Any  # a number or a scalar CasADi expression


@dataclass(frozen=True)
class Ramps:
    """A continuous, piecewise-linear law as straight line plus ramps.

    ``force(u) = offset + stiffness * u + sum_i direction_i * k_i * max(direction_i * u - threshold_i, 0)``

    Attributes
    ----------
    offset, stiffness : scalar, unit of force, unit of force per unit of the argument
    terms : tuple of (direction, k, threshold)
        Each ramp: its direction (+1 or -1), its stiffness and where it begins.
    """

    terms: tuple[tuple[int, Scalar, Scalar], ...]
    stiffness: Scalar = 0.0
    offset: Scalar = 0.0

    def force(self, u: Scalar) -> Scalar:
        """Return the force at the argument u."""
        f = self.offset + self.stiffness * u
        for direction, k, threshold in self.terms:
            f = f + direction * k * ca.fmax(direction * u - threshold, 0)
        return f

    def describing(self, amplitude: Scalar) -> Scalar:
        """Return the describing function at an amplitude, whatever the ramps (eq-describing)."""
        N = self.stiffness
        for _, k, threshold in self.terms:
            angle = contact_angle(threshold, amplitude)
            N = N + k * (angle - ca.sin(2 * angle) / 2) / np.pi
        return N


def contact_angle(threshold: Scalar, amplitude: Scalar) -> ca.SX:
    """Return arccos(threshold / amplitude) [rad]; 0 where nothing is reached and pi where all is in contact.

    Both branches are finite with all their derivatives: beyond the ends the derivatives are 0, where
    those of the arc cosine of a clipped ratio would be infinite times 0.

    Parameters
    ----------
    threshold, amplitude : scalar, unit of the argument
    """
    g, Y = ca.SX(threshold), ca.SX(amplitude)
    inside = ca.fabs(g) < Y
    depth = ca.if_else(inside, (Y - g) * (Y + g), 1)  # positive: Y > g strictly
    angle = ca.atan2(ca.sqrt(depth), ca.if_else(inside, g, 0))
    return ca.if_else(inside, angle, ca.if_else(g < 0, np.pi, 0))
