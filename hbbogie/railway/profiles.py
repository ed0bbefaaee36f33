"""Profiles of wheels and rails, in millimetres: by formula, from published points, from text files."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property
from importlib.resources import files
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline, PPoly

from hbbogie.errors import ModelError, as_number, told

Array = NDArray[np.float64]
FLANGE = 10.0  # mm: what a flange or the side of a rail head is at least higher than the running surface
FEWEST = 10  # points of a profile
STEEP = 50.0  # slope from which points are joined by straight lines: splines overshoot beside upright faces
LEANING = 0.2  # inclination of a rail, at most
ROUNDS = 2.0  # length of a contour over the way round all of it, at most: measured points may be noisy


@dataclass(frozen=True, eq=False)
class Profile:
    """The cross-section of a wheel or of a rail, a cubic spline through points, with straight lines on upright faces.

    Parameters
    ----------
    name : str
    y : ndarray, shape (m,), mm
        Lateral positions, increasing, at least ten. On a wheel y = 0 is the rolling circle and the flange has y < 0. On
        a rail the gauge face has y < 0.
    z : ndarray, shape (m,), mm
        Heights, positive downwards. On a wheel z(0) = 0, so that the rolling radius grows with z.
    """

    name: str
    y: Array
    z: Array

    def __post_init__(self) -> None:
        y, z = (np.asarray(a, dtype=float) for a in (self.y, self.z))
        if y.ndim != 1 or y.shape != z.shape or len(y) < FEWEST or not np.isfinite([y, z]).all():
            raise ModelError(
                f"profile {self.name!r}: got y of shape {y.shape} and z of shape {z.shape}; give two lists of finite "
                f"numbers of one length, at least {FEWEST}."
            )
        if (np.diff(y) <= 0).any():
            raise ModelError(f"profile {self.name!r}: y must increase from point to point; sort the points.")
        object.__setattr__(self, "y", y)
        object.__setattr__(self, "z", z)

    @cached_property
    def spline(self) -> PPoly:
        """The curve z(y): cubic splines, and straight lines between points that are one above the other."""
        coefficients = np.zeros((4, len(self.y) - 1))
        coefficients[2], coefficients[3] = np.diff(self.z) / np.diff(self.y), self.z[:-1]
        gentle = np.concatenate([[False], np.abs(coefficients[2]) < STEEP, [False]])
        for first, last in np.flatnonzero(np.diff(gentle)).reshape(-1, 2):
            piece = CubicSpline(self.y[first : last + 1], self.z[first : last + 1])
            coefficients[:, first:last] = piece.c
        return PPoly(coefficients, self.y)

    def height(self, y: ArrayLike) -> Array:
        """Return z [mm] at lateral positions [mm], positive downwards; NaN beyond the profile."""
        return np.asarray(self.spline(y, extrapolate=False))

    def slope(self, y: ArrayLike) -> Array:
        """Return dz/dy [1] at lateral positions [mm]; NaN beyond the profile."""
        return np.asarray(self.spline(y, 1, extrapolate=False))


# S1002: where the sections A to H meet [mm], and their coefficients
JOINTS = (32.15796, -26.0, -35.0, -38.426669071, -39.764473993, -49.662510381, -62.764705882)
SECTION_A = (1.364323640, -0.066666667)
SECTION_B = (
    *(0.0, -3.358537058e-02, 1.565681624e-03, -2.810427944e-05, 5.844240864e-08),
    *(-1.562379023e-08, 5.309217349e-15, -5.957839843e-12, 2.646656573e-13),
)
SECTION_C = (
    *(-4.320221063e03, -1.038384026e03, -1.065501873e02, -6.051367875),
    *(-2.054332446e-01, -4.169739389e-03, -4.687195829e-05, -2.252755540e-07),
)
SECTION_E = (-93.576667419, -2.747477419)
ARCS = {  # D, F, G, H: height and position of the centre, radius, and the side of the arc
    "D": (16.446, -26.210665, 13.0, -1),
    "F": (8.834924130, -58.558326413, 20.0, 1),
    "G": (16.0, -55.0, 12.0, 1),
    "H": (9.519259302, -49.5, 20.5, 1),
}


def s1002_height(y: ArrayLike) -> Array:
    """Return the height of the wheel profile S1002 by its formula.

    Parameters
    ----------
    y : array_like, mm
        From -70, the back of the flange, to 60.

    Returns
    -------
    ndarray, shape of y, mm
        Positive downwards; NaN beyond the profile.

    References
    ----------
    UIC 510-2 and EN 13715; coefficients as in the course files of Lund University (courtesy of H. Netter, DLR).
    """
    y = np.asarray(y, dtype=float)

    def polynomial(coefficients: tuple[float, ...]) -> Array:
        return np.asarray(np.polynomial.polynomial.polyval(y, coefficients))

    def arc(name: str) -> Array:
        z0, y0, radius, side = ARCS[name]
        return np.asarray(z0 + side * np.sqrt(np.maximum(radius**2 - (y - y0) ** 2, 0)))

    a, b, c, d, e, f, g = JOINTS
    places = [y > 60, y > a, y > b, y > c, y > d, y > e, y > f, y > g, y >= -70]
    heights = [polynomial(s) for s in (SECTION_A, SECTION_B, SECTION_C)]
    heights += [arc("D"), polynomial(SECTION_E), *(arc(name) for name in "FGH")]
    return np.select(places, [np.full(y.shape, np.nan), *heights], np.nan)


def s1002() -> Profile:
    """Return the wheel profile S1002, points of its formula every 0.05 mm and where its sections meet.

    Examples
    --------
    >>> from hbbogie.railway import s1002
    >>> round(float(s1002().height(-55.0)), 6)  # the tip of the flange
    28.0
    """
    y = np.unique(np.concatenate([np.linspace(-70.0, 60.0, 2601), JOINTS]))
    y = y[np.append(np.diff(y) > 1e-3, True)]
    return Profile("S1002", y, s1002_height(y))


def uic60(inclination: float = 1 / 40) -> Profile:
    """Return the rail profile UIC60 by the points of the Manchester contact benchmark.

    Parameters
    ----------
    inclination : float, 1
        Slope by which the rail leans inwards, such as 1/20; 0 for an upright one.

    References
    ----------
    P. Shackleton, S. Iwnicki, Comparison of wheel-rail contact codes for railway vehicle simulation, Vehicle System
    Dynamics 46, 2008; points from the examples of the open-source program CONTACT (Apache-2.0).
    """
    y, z = _points("uic60.csv", (files("hbbogie.railway") / "uic60.csv").read_text("utf-8"))  # inclined 1:40
    return _rail("UIC60", y, z, False, _leaning(inclination) - np.arctan(1 / 40))


def read_wheel(path: str | Path) -> Profile:
    """Read a wheel profile from a text file of two columns, lateral position and height in millimetres.

    Columns are separated by blanks, tabs, commas or semicolons; decimal commas are understood where the columns are
    not separated by commas. Lines of text may stand before and after the numbers, and comments after #, ! or %. The
    rolling circle must be at
    y = 0. Either axis may point either way: the profile is turned so that its flange points down and lies at y < 0.
    Points under an overhang are left out.

    Parameters
    ----------
    path : str or path

    Raises
    ------
    ModelError
        When the file cannot be read, or the numbers are no wheel with a flange.
    """
    name = Path(path).stem
    y, z = _points(str(path), _text(path))
    if np.ptp(z) > np.ptp(y) > 0:
        raise ModelError(
            f"{name}: the wheel would be {np.ptp(y):.4g} mm wide and {np.ptp(z):.4g} mm high; give the lateral "
            "position in the first column and the height in the second."
        )
    if not y.min() < 0 < y.max():
        raise ModelError(
            f"{name}: y runs from {y.min():g} to {y.max():g} mm; shift it so that the rolling circle is at y = 0."
        )
    z = z - z[np.argmin(np.abs(y))]
    tip = int(np.argmax(np.abs(z)))
    if abs(z[tip]) < FLANGE:
        raise ModelError(
            f"{name}: no point is more than {FLANGE:g} mm above or below the rolling circle; give a wheel with its "
            "flange, in millimetres."
        )
    z = z * np.sign(z[tip])
    y = -y * np.sign(y[tip])
    y, z = _from_above(y, z, int(np.argmin(np.abs(y))))
    profile = Profile(name, y, z)
    return Profile(name, y, z - profile.height(0.0))


def read_rail(path: str | Path, mirrored: bool = False, inclination: float = 0.0) -> Profile:
    """Read a rail profile from a text file of two columns; its format is that of `read_wheel`.

    The gauge face is the side with y < 0. The height may point up or down: the rail is turned so that its head is up.

    Parameters
    ----------
    path : str or path
    mirrored : bool
        Whether the file has the gauge face at y > 0.
    inclination : float, 1
        Slope by which the rail is turned inwards, such as 1/20 for the drawing of an upright rail; 0 where the rail
        has its inclination in the file, as measured ones have.

    Raises
    ------
    ModelError
        When the file cannot be read, or the numbers are no head of a rail.
    """
    turn = _leaning(inclination)
    return _rail(Path(path).stem, *_points(str(path), _text(path)), mirrored, turn)


def _leaning(inclination: float) -> float:
    """Return the angle of an inclination [rad]."""
    if not abs(as_number(inclination)) <= LEANING:
        raise ModelError(
            f"rail inclination: got {told(inclination)}; give a slope of at most {LEANING:g}, such as 0.025 for 1:40."
        )
    return float(np.arctan(inclination))


def _rail(name: str, y: Array, z: Array, mirrored: bool, turn: float) -> Profile:
    """Return the head of a rail, turned inwards by an angle [rad]."""
    middle = z[np.argmin(np.abs(y - (y.min() + y.max()) / 2))]
    sides = z[np.argmin(y)], z[np.argmax(y)]
    z = z * np.sign(sum(sides) - 2 * middle)
    if z.max() - z.min() < FLANGE:
        raise ModelError(
            f"{name}: the sides of the head reach {z.max() - z.min():g} mm down; give a rail head with its sides, at "
            f"least {FLANGE:g} mm, in millimetres."
        )
    y = -y if mirrored else y
    if turn:
        y, z = y * np.cos(turn) + z * np.sin(turn), z * np.cos(turn) - y * np.sin(turn)
    return Profile(name, *_from_above(y, z, int(np.argmin(z))))


def _text(path: str | Path) -> str:
    try:
        return Path(path).read_text("utf-8-sig", errors="replace")
    except OSError as error:
        raise ModelError(
            f"cannot read the profile {str(path)!r}: {error.strerror}; give the path of a text file."
        ) from error


def _points(where: str, text: str) -> tuple[Array, Array]:
    """Return the two columns of a text."""
    rows: list[tuple[float, float]] = []
    after = 0  # the line of text that ended the numbers
    for number, line in enumerate(text.splitlines(), 1):
        fields = _fields(line)
        if not fields:
            after = after or (number if rows and re.search(r"[^\W\d]", line) else 0)
        elif len(fields) != 2 or after:
            why = f"stands after the text of line {after}" if after else f"has {len(fields)} numbers"
            raise ModelError(f"{where}: line {number}, {line.strip()!r}, {why}; give one block of two columns.")
        elif not np.isfinite(fields).all():
            raise ModelError(f"{where}: line {number}, {line.strip()!r}, is no finite point; leave such points out.")
        else:
            rows.append((fields[0], fields[1]))
    if len(rows) < FEWEST:
        raise ModelError(f"{where}: {len(rows)} lines of two numbers; give at least {FEWEST} points, as y z in mm.")
    y, z = np.array(rows).T
    length, round_it = np.hypot(np.diff(y), np.diff(z)).sum(), 2 * (np.ptp(y) + np.ptp(z))
    if length > ROUNDS * round_it:
        raise ModelError(
            f"{where}: from point to point it is {length:.4g} mm, and {round_it:.4g} mm around them all; give the "
            "points in their order along the contour."
        )
    return y, z


def _fields(line: str) -> list[float]:
    """Return the numbers of a line, before a comment; none for text or an empty line."""
    line = re.split(r"[#!%]|//", line)[0].strip().rstrip(";,")
    parts = re.split(r"\s*;\s*|\s+", line)
    if len(parts) == 1 or any(part.endswith(",") for part in parts):
        parts = re.split(r"\s*,\s*", line)
    try:
        return [float(part.replace(",", ".")) for part in parts]
    except ValueError:
        return []


def _from_above(y: Array, z: Array, start: int) -> tuple[Array, Array]:
    """Return the part of a contour that is seen from above, walking to both sides from a point of it, y increasing."""
    if y[-1] < y[0]:
        y, z, start = y[::-1], z[::-1], len(y) - 1 - start
    right, left = y[start:], -y[start::-1]
    kept = [np.flatnonzero(np.append(True, side[1:] > np.maximum.accumulate(side)[:-1])) for side in (right, left)]
    indices = np.concatenate([(start - kept[1])[:0:-1], start + kept[0]])
    return y[indices], z[indices]
