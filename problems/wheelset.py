"""One wheelset on springs: Klingel's motion, the critical speed in closed form, and the flange.

A wheelset runs at speed V on straight, level track. Springs hold it in a frame that moves straight ahead. Its
coordinates are the lateral displacement y and the yaw psi; Fx and Fy are the resistances of one wheel to the creepages:

    m y''   + 2 Fy + ky y + FT(y)     = 0,    Fy = f22 (y'/V - psi)
    I psi'' + 2 a Fx + kpsi psi       = 0,    Fx = f11 (a psi'/V + lam y/r0)

FT is the flange, a spring behind a gap. The linear equations lose their stability at a speed that has a closed form.
Beyond the gap harmonic balance with one harmonic has a closed form, too: the flange's describing function takes its
place beside ky. `wheelset_on_profiles` is the variant with profiles instead of a cone, and the creep law of Polach.

Source: J. Klingel, Ueber den Lauf der Eisenbahnwagen auf gerader Bahn, Organ fuer die Fortschritte des Eisenbahnwesens
38 (1883) 113-123, for the wavelength. Critical speed and branch follow from the equations above.
Assumptions: small angles, equal wheels, no spin, no gravity stiffness, no dampers.

Symbols: y [m] lateral; psi [rad] yaw; V [m/s] speed; m [kg], I [kg m2] mass and yaw inertia; ky [N/m], kpsi [N m]
springs; a [m] half the distance of the rolling circles; r0 [m] wheel radius; lam [1] conicity; f11, f22 [N] creep
coefficients of a wheel; K0 [N/m], y0 [m] flange stiffness and clearance.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from hbbogie import Coordinate, Element, ModelError, Output, Parameter, System
from hbbogie.model import DeadBand, Spline, Tabulated
from hbbogie.railway import (
    Polach,
    contact_geometry,
    derailment_quotient,
    guiding_forces,
    hertz_ellipse,
    kalker_coefficients,
    s1002,
    uic60,
)

POSITIVE, ANY_SIGN = (1e-12, 1e15), (0.0, 1e15)
SMOOTHING = 1e-11  # m3, of the spline through the radius differences, which have a step


def wheelset(**parameters: float) -> System:
    """Return the wheelset with conical wheels, linear creep and a flange.

    Parameters
    ----------
    **parameters : float
        Parameter values that replace the defaults, by name, in the units listed above.
    """
    y, psi, common, (V, m, I, ky, kpsi, a, r0, K0, y0) = _suspended()
    lam = Parameter("lam", 0.2, "1", "conicity", ANY_SIGN)
    f11 = Parameter("f11", 9.4e6, "N", "longitudinal creep coefficient", ANY_SIGN)
    f22 = Parameter("f22", 8.7e6, "N", "lateral creep coefficient", ANY_SIGN)
    xi, eta = a * psi.dot / V + lam * y / r0, y.dot / V - psi
    Fx, Fy = f11 * xi, f22 * eta
    flange = Element("flange", DeadBand(K0, y0), y)
    equations = [m * y.ddot + 2 * Fy + ky * y + flange, I * psi.ddot + 2 * a * Fx + kpsi * psi]
    system = System(
        "wheelset",
        [y, psi],
        [*common, lam, f11, f22],
        equations,
        [flange],
        description="wheelset, linear creep",
        outputs=_outputs(y, flange, Fy, xi * Fx + eta * Fy),
    )
    return system.with_parameters(**parameters)


def wheelset_on_profiles(difference: str = "lines", **parameters: float) -> System:
    """Return the wheelset with wheels S1002 on rails UIC60 and the creep law of Polach.

    The rolling radius difference is that of rigid contact at shifts every 0.5 mm up to 5.5 mm. The flange takes over
    there. There is no published cycle of this variant. Polach's law has no derivative at rest, so that this wheelset
    has no Hopf point in the ordinary sense: its cycles are found from motions.

    Parameters
    ----------
    difference : {"lines", "spline"}
        How the rolling radius difference runs between the shifts: in straight lines whose kinks are located, or as a
        smoothed spline, which is twice differentiable.
    **parameters : float
        Parameter values that replace the defaults, by name, in the units listed above; Q [N] wheel load and mu [1]
        coefficient of friction take the place of lam, f11 and f22.
    """
    y, psi, common, (V, m, I, ky, kpsi, a, r0, K0, y0) = _suspended(y0=5.5e-3)
    Q = Parameter("Q", 54.5e3, "N", "wheel load", POSITIVE)
    mu = Parameter("mu", 0.3, "1", "coefficient of friction", POSITIVE)
    shift = np.linspace(-5.5, 5.5, 23)  # mm
    table = (1e-3 * shift).tolist(), (1e-3 * contact_geometry(s1002(), uic60(), shift).radius_difference).tolist()  # m
    laws = {"lines": Tabulated(*table), "spline": Spline(*table, smoothing=SMOOTHING)}
    if difference not in laws:
        raise ModelError(f"wheelset_on_profiles: difference = {difference!r}; give one of {', '.join(laws)}.")
    rolling = Element("radius difference", laws[difference], y)
    ellipse = hertz_ellipse(54.5e3, wheel_radius=0.46, rail_radius=0.3)
    c11, c22, c23, _ = kalker_coefficients(ellipse.a / ellipse.b)
    creep = Polach(ellipse.a, ellipse.b, ellipse.shear, c11, c22, c23, load=Q, friction=mu)
    xi, eta = a * psi.dot / V + rolling / (2 * r0), y.dot / V - psi
    Fx, Fy = creep.force(xi, eta)  # on the wheel
    flange = Element("flange", DeadBand(K0, y0), y)
    equations = [m * y.ddot - 2 * Fy + ky * y + flange, I * psi.ddot - 2 * a * Fx + kpsi * psi]
    system = System(
        "wheelset on profiles",
        [y, psi],
        [*common, Q, mu],
        equations,
        [rolling, flange],
        description="wheelset, S1002 on UIC60, creep of Polach",
        outputs=[
            *_outputs(y, flange, -Fy, -(xi * Fx + eta * Fy)),
            derailment_quotient("Y/Q", flange - Fy, Q),
        ],
    )
    return system.with_parameters(**parameters)


def _suspended(y0: float = 8e-3) -> tuple[Coordinate, Coordinate, list[Parameter], list[Parameter]]:
    """Return the coordinates, and the parameters of wheelset, springs and flange."""
    found = [
        Parameter("V", 48.0, "m/s", "speed", (1.0, 400.0)),
        Parameter("m", 1813.0, "kg", "mass", POSITIVE),
        Parameter("I", 1120.0, "kg m2", "yaw inertia", POSITIVE),
        Parameter("ky", 1e6, "N/m", "lateral stiffness", ANY_SIGN),
        Parameter("kpsi", 2e6, "N m", "yaw stiffness", ANY_SIGN),
        Parameter("a", 0.75, "m", "half the distance of the rolling circles", POSITIVE),
        Parameter("r0", 0.46, "m", "wheel radius", POSITIVE),
        Parameter("K0", 14.6e6, "N/m", "flange stiffness", ANY_SIGN),
        Parameter("y0", y0, "m", "flange clearance", POSITIVE),
    ]
    return Coordinate("y", "m", "lateral"), Coordinate("psi", "rad", "yaw"), found, found


def _outputs(y: Coordinate, flange: Element, Fy: Any, wear: Any) -> list[Output]:
    """Return what is measured, from lateral resistance [N] and energy lost per metre [N] of one wheel."""
    return [
        Output("axle acceleration", y.ddot, "m/s2", "lateral acceleration of the wheelset"),
        Output("flange force", flange, "N", "of the rail on the wheelset, without the creep forces"),
        guiding_forces("guiding forces", 2 * Fy, flange),
        Output("wear number", 2 * wear, "N", "T gamma of both wheels, energy lost per metre"),
    ]


def klingel_wavelength(a: float, r0: float, lam: float, lb: float = 0.0) -> float:
    """Return the wavelength [m] of a wheelset, or of a rigid bogie of half wheelbase lb, that rolls without slip.

    Parameters
    ----------
    a, r0 : float, m
    lam : float, 1
    lb : float, m
    """
    return float(2 * np.pi * np.sqrt(a * r0 / lam * (1 + (lb / a) ** 2)))


def critical_speed(p: Any, keq: float = 0.0) -> tuple[float, float]:
    """Return the speed [m/s] and the frequency [rad/s] of the undamped motion, with a flange of stiffness keq [N/m].

    Parameters
    ----------
    p : mapping from name to value
        Of the parameters of `wheelset`.
    keq : float, N/m
        0 for the linear critical speed.
    """
    ky = p["ky"] + keq
    m, I, kpsi, a, f11, f22 = (p[name] for name in ("m", "I", "kpsi", "a", "f11", "f22"))
    square = (f22 * kpsi + a**2 * f11 * ky) / (m * a**2 * f11 + I * f22)
    springs = (ky - m * square) * (kpsi - I * square)
    V = 2 * a * np.sqrt(f11 * f22 * square / (springs + 4 * f11 * f22 * a * p["lam"] / p["r0"]))
    return float(V), float(np.sqrt(square))


def first_harmonic_cycle(p: Any, Y: float) -> tuple[float, float]:
    """Return the speed [m/s] and the frequency [rad/s] of the cycle of lateral amplitude Y by one harmonic.

    Parameters
    ----------
    p : mapping from name to value
        Of the parameters of `wheelset`.
    Y : float, m
    """
    t = np.arccos(min(p["y0"] / Y, 1.0))
    return critical_speed(p, p["K0"] / np.pi * (2 * t - np.sin(2 * t)))


SYSTEM = wheelset
PARAMETER = "V"
RANGE = (30.0, 80.0)


@dataclass(frozen=True)
class Point:
    """A critical speed or a cycle of one harmonic, computed from the closed forms with 10 digits.

    Attributes
    ----------
    parameters : dict
        What differs from the defaults.
    Y : float, m
        Lateral amplitude; 0 at the critical speed.
    V : float, m/s
    omega : float, rad/s
    """

    parameters: dict[str, float]
    Y: float
    V: float
    omega: float


SOFT = {"ky": 2e6, "kpsi": 1e6, "lam": 0.1, "f11": 6e6, "f22": 6e6}
POINTS = (
    Point({}, 0.0, 45.15947514, 34.25900348),
    Point(SOFT, 0.0, 58.56099107, 31.51313479),
    Point({}, 0.0082, 45.49842651, 34.52351875),
    Point({}, 0.009, 48.3153102, 36.71847435),
)
