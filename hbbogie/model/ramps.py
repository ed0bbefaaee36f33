"""Piecewise-linear laws as straight line plus ramps, and jumps where the ramps begin."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

Scalar = Any  # a number or a scalar CasADi expression


@dataclass(frozen=True)
class Ramps:
    """A piecewise-linear law as straight line plus ramps, which may begin with a jump.

    ``force(u) = offset + stiffness * u
    + sum_i direction_i * (k_i * max(depth_i, 0) + height_i * (depth_i > 0)), depth_i = direction_i * u - threshold_i``

    Attributes
    ----------
    offset, stiffness : scalar, unit of force, unit of force per unit of the argument
    terms : tuple of (direction, k, threshold)
        Each ramp: its direction (+1 or -1), its stiffness and where it begins.
    heights : tuple of scalar, unit of force
        The jump where each ramp begins; empty for a continuous law.
    """

    terms: tuple[tuple[int, Scalar, Scalar], ...]
    stiffness: Scalar = 0.0
    offset: Scalar = 0.0
    heights: tuple[Scalar, ...] = ()

    def force(self, u: Scalar, spread: Scalar = None) -> Scalar:
        """Return the force at the argument u; half way up at a jump.

        Parameters
        ----------
        u : scalar, unit of the argument
        spread : scalar, unit of the argument
            Where given, jumps are straight lines over so much of the argument.
        """
        f = self.offset + self.stiffness * u
        for direction, k, threshold in self.terms:
            f = f + direction * k * ca.fmax(direction * u - threshold, 0)
        for (direction, _, threshold), height in zip(self.terms, self.heights, strict=False):
            depth = direction * u - threshold
            share = ca.heaviside(depth) if spread is None else ca.fmin(ca.fmax(0.5 + depth / spread, 0), 1)
            f = f + direction * height * share
        return f

    def describing(self, amplitude: Scalar) -> Scalar:
        """Return the describing function at an amplitude, whatever the ramps (eq-describing)."""
        N = self.stiffness
        for _, k, threshold in self.terms:
            angle = contact_angle(threshold, amplitude)
            N = N + k * (angle - ca.sin(2 * angle) / 2) / np.pi
        for (_, _, threshold), height in zip(self.terms, self.heights, strict=False):
            N = N + 2 * height * ca.sin(contact_angle(threshold, amplitude)) / (np.pi * amplitude)
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
