"""Where wheels touch rails, and the conicities that follow."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hbbogie.brief import lines
from hbbogie.results.pictures import draw, page

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ContactGeometry:
    """The contact of a rigid wheelset with rigid rails over its lateral shift.

    Right and left are those of someone who looks forward. Positions on a wheel count from the rolling circle, negative
    towards the flange, and on a rail as in its profile.

    Attributes
    ----------
    wheel, rail : str
        Names of the profiles.
    shift : ndarray, shape (n,), mm
        Lateral position of the wheelset, positive to the right.
    roll : ndarray, shape (n,), rad
        Positive where the right wheel goes down.
    lowering : ndarray, shape (n,), mm
        How far the axle lies lower than with its rolling circles at the height of the rail tops.
    radius_right, radius_left : ndarray, shape (n,), mm
        Rolling radii.
    angle_right, angle_left : ndarray, shape (n,), rad
        Contact angles to the plane of the track, positive towards the flange.
    wheel_right, wheel_left, rail_right, rail_left : ndarray, shape (n,), mm
        Contact points on the profiles of wheel and rail.
    """

    wheel: str
    rail: str
    shift: Array
    roll: Array
    lowering: Array
    radius_right: Array
    radius_left: Array
    angle_right: Array
    angle_left: Array
    wheel_right: Array
    wheel_left: Array
    rail_right: Array
    rail_left: Array

    def __repr__(self) -> str:
        difference, angles = self.radius_difference, np.degrees(np.append(self.angle_right, self.angle_left))
        return lines(
            f"Contact of {self.wheel} on {self.rail}: {len(self.shift)} lateral shifts, {self.shift.min():g} to "
            f"{self.shift.max():g} mm",
            f"rolling radius difference {difference.min():.4g} to {difference.max():.4g} mm",
            f"contact angles {angles.min():.3g} to {angles.max():.3g} degrees",
        )

    def _repr_html_(self) -> str:
        return page(repr(self), (), "contact", self)

    def plot(self, **options: Any) -> Any:
        """Draw it over the lateral shift; options and the axes returned as of `hbbogie.plot.contact`."""
        return draw("contact", self, **options)

    @property
    def radius_difference(self) -> Array:
        """The rolling radius difference, right minus left [mm]."""
        return self.radius_right - self.radius_left
