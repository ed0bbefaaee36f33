"""The contact ellipse by Hertz, and Kalker's coefficients of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.special import ellipe, elliprd

from hbbogie.errors import ModelError, as_number, positive, told
from hbbogie.railway.creep import LinearKalker

STEEL_SHEAR, STEEL_POISSON = 8.2e10, 0.28  # Pa and 1, those of the Manchester contact benchmark
NU = np.array([0.0, 0.25, 0.5])
RATIOS = np.linspace(0.1, 1.0, 10)
# Kalker 1990, Table E.3: for each min(a/b, b/a) a row, the coefficients C11, C22, C23, C33 at the three NU
NARROW = np.array(  # a < b
    [
        [[2.51, 3.31, 4.85], [2.51, 2.52, 2.53], [0.334, 0.473, 0.731], [6.42, 8.28, 11.7]],
        [[2.59, 3.37, 4.81], [2.59, 2.63, 2.66], [0.483, 0.603, 0.809], [3.46, 4.27, 5.66]],
        [[2.68, 3.44, 4.80], [2.68, 2.75, 2.81], [0.607, 0.715, 0.889], [2.49, 2.96, 3.72]],
        [[2.78, 3.53, 4.82], [2.78, 2.88, 2.98], [0.720, 0.823, 0.977], [2.02, 2.32, 2.77]],
        [[2.88, 3.62, 4.83], [2.88, 3.01, 3.14], [0.827, 0.929, 1.07], [1.74, 1.93, 2.22]],
        [[2.98, 3.72, 4.91], [2.98, 3.14, 3.31], [0.930, 1.03, 1.18], [1.56, 1.68, 1.86]],
        [[3.09, 3.81, 4.97], [3.09, 3.28, 3.48], [1.03, 1.14, 1.29], [1.43, 1.50, 1.60]],
        [[3.19, 3.91, 5.05], [3.19, 3.41, 3.65], [1.13, 1.25, 1.40], [1.34, 1.37, 1.42]],
        [[3.29, 4.01, 5.12], [3.29, 3.54, 3.82], [1.23, 1.36, 1.51], [1.27, 1.27, 1.27]],
        [[3.40, 4.12, 5.20], [3.40, 3.67, 3.98], [1.33, 1.47, 1.63], [1.21, 1.19, 1.16]],
    ]
)
LONG = np.array(  # a > b
    [
        [[10.7, 11.7, 12.9], [10.7, 12.8, 16.0], [12.2, 14.6, 18.0], [0.795, 0.526, 0.228]],
        [[6.96, 7.78, 8.82], [6.96, 8.14, 9.79], [5.72, 6.63, 7.89], [0.828, 0.601, 0.341]],
        [[5.57, 6.34, 7.34], [5.57, 6.40, 7.51], [3.79, 4.32, 5.01], [0.868, 0.674, 0.446]],
        [[4.84, 5.57, 6.57], [4.84, 5.48, 6.31], [2.88, 3.24, 3.70], [0.912, 0.747, 0.549]],
        [[4.37, 5.10, 6.11], [4.37, 4.90, 5.56], [2.35, 2.62, 2.96], [0.958, 0.819, 0.650]],
        [[4.06, 4.78, 5.80], [4.06, 4.50, 5.04], [2.01, 2.23, 2.50], [1.01, 0.892, 0.751]],
        [[3.82, 4.54, 5.58], [3.82, 4.21, 4.67], [1.76, 1.95, 2.18], [1.05, 0.965, 0.852]],
        [[3.65, 4.36, 5.42], [3.65, 3.99, 4.39], [1.58, 1.75, 1.94], [1.10, 1.04, 0.954]],
        [[3.51, 4.22, 5.30], [3.51, 3.81, 4.16], [1.44, 1.59, 1.77], [1.16, 1.11, 1.06]],
        [[3.40, 4.12, 5.20], [3.40, 3.67, 3.98], [1.33, 1.47, 1.63], [1.21, 1.19, 1.16]],
    ]
)


@dataclass(frozen=True)
class ContactEllipse:
    """A contact ellipse.

    Attributes
    ----------
    a, b : float, m
        Semi-axes in the rolling direction and across.
    shear : float, Pa
        Shear modulus of wheel and rail.
    nu : float, 1
        Poisson's ratio of wheel and rail.
    """

    a: float
    b: float
    shear: float = STEEL_SHEAR
    nu: float = STEEL_POISSON

    def __post_init__(self) -> None:
        for name, unit in (("a", "m"), ("b", "m"), ("shear", "Pa")):
            positive(f"ContactEllipse: {name}", getattr(self, name), unit)

    def kalker(self) -> LinearKalker:
        """Return Kalker's linear creep law, with coefficients from his table."""
        c11, c22, c23, c33 = kalker_coefficients(self.a / self.b, self.nu)
        area, G = self.a * self.b, self.shear
        return LinearKalker(G * area * c11, G * area * c22, G * area**1.5 * c23, G * area**2 * c33)


def kalker_coefficients(ratio: float, nu: float = STEEL_POISSON) -> tuple[float, float, float, float]:
    """Return Kalker's creepage and spin coefficients C11, C22, C23 and C33 from his table.

    Between rows of the table values are linear in the smaller of a/b and b/a. Between its columns the inverses are
    quadratic in Poisson's ratio.

    Parameters
    ----------
    ratio : float, 1
        a/b, of the semi-axes in the rolling direction and across, 0.1 to 10.
    nu : float, 1
        Poisson's ratio, 0 to 0.5.

    Raises
    ------
    ModelError
        For values outside the table.

    References
    ----------
    J. J. Kalker, Three-Dimensional Elastic Bodies in Rolling Contact, Kluwer 1990, Table E.3.

    Examples
    --------
    >>> from hbbogie.railway import kalker_coefficients
    >>> [round(c, 3) for c in kalker_coefficients(1 / 0.7, nu=0.25)]
    [4.54, 4.21, 1.95, 0.965]
    """
    if not 0.1 - 1e-12 <= as_number(ratio) <= 10 + 1e-12:
        raise ModelError(
            f"a/b = {told(ratio)} is outside Kalker's table; give 0.1 to 10, or the coefficients themselves."
        )
    if not 0 <= as_number(nu) <= 0.5:
        raise ModelError(f"Poisson's ratio nu = {told(nu)} is outside Kalker's table; give 0 to 0.5.")
    ratio, nu = float(ratio), float(nu)
    table, g = (NARROW, ratio) if ratio <= 1 else (LONG, 1 / ratio)
    place = np.clip((g - 0.1) / 0.1, 0, 9)
    row = min(int(place), 8)
    inverse = 1 / (table[row] + (place - row) * (table[row + 1] - table[row]))
    weights = [8 * (nu - 0.25) * (nu - 0.5), -16 * nu * (nu - 0.5), 8 * nu * (nu - 0.25)]  # Lagrange, at NU
    c11, c22, c23, c33 = (float(c) for c in 1 / (inverse @ weights))
    return c11, c22, c23, c33


def hertz_ellipse(
    load: float,
    wheel_radius: float,
    rail_radius: float,
    wheel_profile_radius: float = np.inf,
    *,
    shear: float = STEEL_SHEAR,
    nu: float = STEEL_POISSON,
) -> ContactEllipse:
    """Return the ellipse in which a wheel touches a rail, by Hertz.

    Parameters
    ----------
    load : float, N
        Normal force.
    wheel_radius : float, m
        Rolling radius.
    rail_radius : float, m
        Radius of the rail's profile at the contact.
    wheel_profile_radius : float, m
        Radius of the wheel's profile at the contact, negative where it is hollow; infinite for a cone.
    shear : float, Pa
        Shear modulus of wheel and rail.
    nu : float, 1
        Poisson's ratio of both.

    Raises
    ------
    ModelError
        For a load, radius or modulus that is not positive, and for a hollow wheel that is not flatter than the rail.

    References
    ----------
    K. L. Johnson, Contact Mechanics, Cambridge University Press 1985, section 4.2.

    Examples
    --------
    >>> from hbbogie.railway import hertz_ellipse
    >>> ellipse = hertz_ellipse(54.5e3, wheel_radius=0.46, rail_radius=0.3)
    >>> round(1e3 * ellipse.a, 2), round(1e3 * ellipse.b, 2)
    (5.88, 4.42)
    """
    positive("load", load, "N")
    positive("shear", shear, "Pa")
    if not -1 < as_number(nu) <= 0.5:
        raise ModelError(f"hertz_ellipse: Poisson's ratio nu = {told(nu)}; give a number above -1 and up to 0.5.")
    hollow = as_number(wheel_profile_radius)
    if np.isnan(hollow) or hollow == 0:
        raise ModelError(
            f"wheel_profile_radius: got {told(wheel_profile_radius)}; give a number in m, negative for a hollow wheel "
            "and infinite for a cone."
        )
    along = 1 / positive("wheel_radius", wheel_radius, "m")
    across = 1 / positive("rail_radius", rail_radius, "m") + 1 / hollow
    if not across > 0:
        raise ModelError(
            f"a wheel profile of radius {wheel_profile_radius:g} m encloses a rail of {rail_radius:g} m: the "
            "contact is no ellipse; give a wheel radius that is positive, or negative and larger than the rail's."
        )
    flat, steep = sorted((along, across))

    def mismatch(log_ratio: float) -> float:  # of the curvatures, for the ratio of the semi-axes
        q = np.exp(-2 * log_ratio)
        return float(elliprd(0, q, 1) * steep - elliprd(0, 1, q) * flat)

    ratio = float(np.exp(brentq(mismatch, 0.0, 20.0, xtol=1e-14)))
    modulus = shear / (1 - nu)  # of both bodies together
    E = ellipe(1 - 1 / ratio**2)
    small = (3 * load * E / (np.pi * ratio * modulus * (flat + steep))) ** (1 / 3)
    a, b = (ratio * small, small) if along <= across else (small, ratio * small)
    return ContactEllipse(float(a), float(b), shear, nu)
