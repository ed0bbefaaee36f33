"""Equivalent conicity of a rolling radius difference: by EN 15302, by least squares, by the describing function.

The rolling radius difference is piecewise linear between the points of its table, and all integrals of it are exact.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hbbogie.errors import ModelError
from hbbogie.results.conicity import Conicity

Array = NDArray[np.float64]
ANGLES = (np.arange(400) + 0.5) / 400 * np.pi - np.pi / 2  # rad, midpoints
HALVINGS = 60


def equivalent_conicity(shift: ArrayLike, difference: ArrayLike, amplitude: ArrayLike) -> Conicity:
    """Return the equivalent conicity over the amplitude.

    A wheelset that rolls without slip follows y'' = -difference(y) / (e r0), a motion whose wavelength gives the
    conicity of EN 15302. Its travel of twice the amplitude has its centre where both ends have the same potential.
    The other two definitions are taken over the same travel.

    Parameters
    ----------
    shift : array_like, shape (m,), mm
        Lateral positions of the wheelset, increasing; steps of 0.1 mm are usual.
    difference : array_like, shape (m,), mm
        Rolling radius difference there, positive on the side to which the wheelset has moved, as the
        `radius_difference` of `contact_geometry`.
    amplitude : array_like, shape (n,), mm

    Returns
    -------
    Conicity

    Raises
    ------
    ModelError
        When the travel does not stay inside the table, or the table is not acceptable.

    References
    ----------
    EN 15302, Railway applications - Method for determining the equivalent conicity, clause 6.

    Examples
    --------
    >>> from hbbogie.railway import equivalent_conicity
    >>> equivalent_conicity([-5.0, 5.0], [-1.0, 1.0], [3.0]).equivalent.round(6).tolist()  # cones of 1 in 10
    [0.1]
    """
    table = _Table.of(shift, difference)
    A = np.atleast_1d(np.asarray(amplitude, dtype=float))
    if A.ndim != 1 or not (np.isfinite(A) & (A > 0)).all():
        raise ModelError(f"amplitude: got {amplitude!r}; give finite numbers above 0 in mm.")
    c = table.centres(A)
    with np.errstate(divide="ignore", invalid="ignore"):
        highest = table.potential(c + A)[:, None]
        kinetic = highest - table.potential(c[:, None] + A[:, None] * np.sin(ANGLES))
        # rounding leaves something where the difference is zero over the whole travel: a straight run, no conicity
        kinetic[np.abs(kinetic) < 1e-13 * highest] = 0.0
        kinetic[kinetic < 0] = np.nan
        integral = (A[:, None] * np.cos(ANGLES) / np.sqrt(kinetic)).mean(axis=1) * np.pi
        equivalent = (np.pi / integral) ** 2
    return Conicity(A, c, equivalent, table.linearised(c, A, _squares) / 2, table.linearised(c, A, _first_harmonic) / 2)


@dataclass(frozen=True, eq=False)
class _Table:
    """A piecewise-linear rolling radius difference.

    Attributes
    ----------
    y, d : ndarray, shape (m,), mm
        Shifts and differences.
    slopes : ndarray, shape (m - 1,), 1
    areas : ndarray, shape (m,), mm2
        The potential, the integral of the difference, at the shifts; zero where it is smallest.
    """

    y: Array
    d: Array
    slopes: Array
    areas: Array

    @classmethod
    def of(cls, shift: ArrayLike, difference: ArrayLike) -> _Table:
        """Return the table of shifts and differences, checked."""
        y, d = (np.asarray(a, dtype=float) for a in (shift, difference))
        if y.ndim != 1 or y.shape != d.shape or len(y) < 2 or not np.isfinite([y, d]).all() or (np.diff(y) <= 0).any():
            raise ModelError(
                f"shift and difference: got arrays of shape {y.shape} and {d.shape}; give two lists of finite numbers "
                "of one length, at least 2, with increasing shifts."
            )
        if d[-1] < d[0]:
            raise ModelError(
                f"the rolling radius difference falls from {d[0]:g} to {d[-1]:g} mm over the table; it must grow with "
                "the shift. Turn its sign, or that of the shift, if it is taken the other way round."
            )
        areas = np.append(0.0, np.cumsum(np.diff(y) * (d[1:] + d[:-1]) / 2))
        return cls(y, d, np.diff(d) / np.diff(y), areas - areas.min())

    def potential(self, y: Array) -> Array:
        """Return the potential at shifts inside the table [mm2]."""
        i = np.clip(np.searchsorted(self.y, y, "right") - 1, 0, len(self.y) - 2)
        u = y - self.y[i]
        return np.asarray(self.areas[i] + u * (self.d[i] + self.slopes[i] * u / 2))

    def centres(self, A: Array) -> Array:
        """Return the centres about which the ends of the travel have the same potential [mm], by bisection."""
        low, high = self.y[0] + A, self.y[-1] - A

        def rise(c: Array) -> Array:
            return self.potential(c + A) - self.potential(c - A)

        room = 1e-9 * (self.y[-1] - self.y[0])
        slack = 1e-12 * np.abs(self.areas).max()
        outside = low > high + room
        outside |= ~outside & ((rise(np.minimum(low, high)) > slack) | (rise(np.maximum(low, high)) < -slack))
        if outside.any():
            largest = (self.y[-1] - self.y[0]) / 2
            raise ModelError(
                f"amplitude {A[outside][0]:g} mm: the travel leaves the table of shifts, {self.y[0]:g} to "
                f"{self.y[-1]:g} mm; give amplitudes well below {largest:g} mm, or a longer table."
            )
        for _ in range(HALVINGS):
            c = (low + high) / 2
            f = rise(c)
            low, high = np.where(f <= 0, c, low), np.where(f >= 0, c, high)
        return (low + high) / 2

    def linearised(self, c: Array, A: Array, weight: Callable[[Array], Array]) -> Array:
        """Return mean slopes of the difference over travels.

        Parameters
        ----------
        c, A : ndarray, shape (n,), mm
            Centres and amplitudes.
        weight : callable
            Integral of the weight of the slope, from -1 to a place on the travel, which runs from -1 to 1.
        """
        places = np.clip((self.y - c[:, None]) / A[:, None], -1, 1)
        return np.asarray((np.diff(weight(places), axis=1) * self.slopes).sum(axis=1))


def _squares(x: Array) -> Array:
    """Integral of the weight with which slopes enter the best straight line: (3/4)(1 - x^2)."""
    return 0.75 * (x - x**3 / 3)


def _first_harmonic(x: Array) -> Array:
    """Integral of the weight with which slopes enter the first harmonic: (2/pi) sqrt(1 - x^2)."""
    return np.asarray((x * np.sqrt(1 - x**2) + np.arcsin(x)) / np.pi)
