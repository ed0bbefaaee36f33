"""Hunting of a railway bogie with flange contact, seven degrees of freedom (Yang 1995).

A bogie runs at constant speed V on straight, level, perfect track; the car body does not move
laterally. Coordinates (metres and radians): front wheelset lateral q1 and yaw q2, rear wheelset
lateral q3 and yaw q4, frame lateral q5, yaw q6 and roll q7. Creep is linear (Kalker's notation);
the flange is a spring behind a gap, F(y) = K0 (y - y0) for y > y0, odd in y.

Source: Y.-R. Yang, Limit cycle hunting of a bogie with flanged wheels, Vehicle System Dynamics 24
(1995) 185-196. Masses, stiffnesses, damping constants and lengths are printed there. The creep
coefficients are not; the defaults follow from Kalker's linear theory with one parameter fitted to
Table 1 of the paper (G a_e b_e = 2.277 MN at nu = 1/4, b_e/a_e = 0.7: C11 4.54, C22 4.21, C23 1.95,
C33 0.965), rounded. With them the printed states of equivalent linearisation are met within 0.18 m/s
in speed and 0.02 rad/s in frequency, except state 6, whose printed speed does not fit its own row.
The gravity stiffness is off by default; the axle load W acts through it only.
"""

from __future__ import annotations

from dataclasses import dataclass

from hbbogie import Coordinate, Element, Output, Parameter, System
from hbbogie.model import DeadBand
from hbbogie.railway import frame_acceleration, guiding_forces


def bogie(gravity: bool = False, **parameters: float) -> System:
    """Return the bogie.

    Parameters
    ----------
    gravity : bool
        Whether the gravity stiffness W lam / a (lateral) and -W a lam (yaw) of the wheelsets acts; the system
        then has one parameter more, its share ``kg``.
    **parameters : float
        Parameter values that replace the defaults, by name, in the units listed below.
    """
    q1 = Coordinate("q1", "m", "front wheelset, lateral")
    q2 = Coordinate("q2", "rad", "front wheelset, yaw")
    q3 = Coordinate("q3", "m", "rear wheelset, lateral")
    q4 = Coordinate("q4", "rad", "rear wheelset, yaw")
    q5 = Coordinate("q5", "m", "frame, lateral")
    q6 = Coordinate("q6", "rad", "frame, yaw")
    q7 = Coordinate("q7", "rad", "frame, roll")

    positive, any_sign = (1e-12, 1e15), (0.0, 1e15)
    V = Parameter("V", 90.0, "m/s", "speed", (1.0, 400.0))
    Mw = Parameter("Mw", 1022.0, "kg", "mass of a wheelset", positive)
    Mf = Parameter("Mf", 2918.0, "kg", "mass of the frame", positive)
    Iwy = Parameter("Iwy", 678.0, "kg m2", "yaw inertia of a wheelset", positive)
    Ify = Parameter("Ify", 6780.0, "kg m2", "yaw inertia of the frame", positive)
    Ifr = Parameter("Ifr", 6780.0, "kg m2", "roll inertia of the frame", positive)
    K0 = Parameter("K0", 20e6, "N/m", "flange stiffness", any_sign)
    K1 = Parameter("K1", 3e6, "N/m", "lateral primary stiffness", any_sign)
    K2 = Parameter("K2", 10e6, "N/m", "longitudinal primary stiffness", any_sign)
    K3 = Parameter("K3", 1e6, "N/m", "vertical primary stiffness", any_sign)
    K4 = Parameter("K4", 0.14e6, "N/m", "lateral secondary stiffness", any_sign)
    K5 = Parameter("K5", 0.9e6, "N/m", "vertical secondary stiffness", any_sign)
    K6 = Parameter("K6", 2.71e6, "N m", "yaw secondary stiffness", any_sign)
    D1 = Parameter("D1", 20e3, "N s/m", "vertical secondary damping", any_sign)
    D2 = Parameter("D2", 29.2e3, "N s/m", "lateral secondary damping", any_sign)
    a = Parameter("a", 0.716, "m", "half the distance of the contact points", positive)
    b = Parameter("b", 1.074, "m", "half the wheelbase", any_sign)
    d1 = Parameter("d1", 0.62, "m", "half the spacing of the primary springs", any_sign)
    d2 = Parameter("d2", 0.68, "m", "half the spacing of the secondary springs", any_sign)
    h1 = Parameter("h1", 0.0762, "m", "height from frame centre to primary springs")
    h2 = Parameter("h2", 0.6584, "m", "height from frame centre to secondary springs")
    lam = Parameter("lam", 0.05, "1", "conicity", any_sign)
    W = Parameter("W", 133.34e3, "N", "axle load", any_sign)
    y0 = Parameter("y0", 0.0091, "m", "flange clearance", positive)
    r0 = Parameter("r0", 0.4572, "m", "wheel radius", positive)
    f11 = Parameter("f11", 10.338e6, "N", "longitudinal creep coefficient", any_sign)
    f22 = Parameter("f22", 9.586e6, "N", "lateral creep coefficient", any_sign)
    f23 = Parameter("f23", 23.57e3, "N m", "lateral-spin creep coefficient")
    f33 = Parameter("f33", 61.9, "N m2", "spin creep coefficient", any_sign)

    kg = Parameter("kg", 1.0, "1", "share of the gravity stiffness that acts")

    flange = DeadBand(stiffness=K0, gap=y0)
    front = Element("front flange", flange, q1)
    rear = Element("rear flange", flange, q3)

    def T(y: Coordinate, psi: Coordinate) -> object:
        """Lateral creep force of a wheelset [N], with the gravity stiffness where it acts."""
        creep = 2 * f22 * (y.dot / V - psi) + 2 * f23 * psi.dot / V
        return creep + kg * W * lam / a * y if gravity else creep

    def N(y: Coordinate, psi: Coordinate) -> object:
        """Yaw creep moment of a wheelset [N m], with the gravity stiffness where it acts."""
        creep = 2 * f11 * a * (a * psi.dot / V + lam * y / r0) - 2 * f23 * (y.dot / V - psi) + 2 * f33 * psi.dot / V
        return creep - kg * W * a * lam * psi if gravity else creep

    def sliding(y: Coordinate, psi: Coordinate) -> object:
        """Power that sliding and spinning dissipate in both contacts of a wheelset [W]."""
        xi, eta, spin = a * psi.dot / V + lam * y / r0, y.dot / V - psi, psi.dot / V
        return V * (2 * f11 * xi**2 + 2 * f22 * eta**2 + 2 * f33 * spin**2)

    def pull(y: Coordinate, psi: Coordinate) -> object:
        """Longitudinal force that a wheelset needs to go on at V [N]; T without the gravity stiffness."""
        xi, eta, spin = a * psi.dot / V + lam * y / r0, y.dot / V - psi, psi.dot / V
        return 2 * f11 * xi * lam * y / r0 - (2 * f22 * eta + 2 * f23 * spin) * psi

    A1 = 2 * K1 * (q1 - q5 - b * q6 - h1 * q7)
    A2 = 2 * K1 * (q3 - q5 + b * q6 - h1 * q7)
    A3 = 2 * K2 * d1**2 * (q2 - q6)
    A4 = 2 * K2 * d1**2 * (q4 - q6)
    A5 = 2 * D2 * (q5.dot - h2 * q7.dot) + 2 * K4 * (q5 - h2 * q7)
    A6 = K6 * q6
    A7 = 2 * D1 * d2**2 * q7.dot + 2 * K5 * d2**2 * q7 + 4 * K3 * d1**2 * q7
    equations = [
        Mw * q1.ddot + A1 + T(q1, q2) + front,
        Iwy * q2.ddot + A3 + N(q1, q2),
        Mw * q3.ddot + A2 + T(q3, q4) + rear,
        Iwy * q4.ddot + A4 + N(q3, q4),
        Mf * q5.ddot - A1 - A2 + A5,
        Ify * q6.ddot - b * A1 + b * A2 - A3 - A4 + A6,
        Ifr * q7.ddot - h1 * A1 - h1 * A2 - h2 * A5 + A7,
    ]
    outputs = [
        Output("front flange force", front, "N", "without the creep forces"),
        Output("rear flange force", rear, "N", "without the creep forces"),
        guiding_forces("front guiding forces", T(q1, q2), front),
        guiding_forces("rear guiding forces", T(q3, q4), rear),
        Output("frame lateral acceleration", q5.ddot, "m/s2", "at the centre of the frame"),
        frame_acceleration("frame acceleration, front", q5, q6, b),
        frame_acceleration("frame acceleration, rear", q5, q6, -b),
        Output("damper power", 2 * D2 * (q5.dot - h2 * q7.dot) ** 2 + 2 * D1 * d2**2 * q7.dot**2, "W", "dissipated"),
        Output("creep power", sliding(q1, q2) + sliding(q3, q4), "W", "dissipated by sliding in all four contacts"),
        Output("power of the forward motion", V * (pull(q1, q2) + pull(q3, q4)), "W", "that keeps the hunting going"),
    ]
    creep = [f11, f22, f23, f33, *([kg] if gravity else [])]
    system = System(
        "Yang's bogie",
        [q1, q2, q3, q4, q5, q6, q7],
        [V, Mw, Mf, Iwy, Ify, Ifr, K0, K1, K2, K3, K4, K5, K6, D1, D2, a, b, d1, d2, h1, h2, lam, W, y0, r0, *creep],
        equations,
        [front, rear],
        description="railway bogie with flange contact, Yang (1995)",
        outputs=outputs,
    )
    return system.with_parameters(**parameters)


SYSTEM = bogie
PARAMETER = "V"
RANGE = (60.0, 190.0)


@dataclass(frozen=True)
class State:
    """One row of Table 1 of Yang (1995); None where nothing is printed.

    Attributes
    ----------
    V : float, m/s
        Speed.
    omega_el, omega_ni : float or None, rad/s
        Frequency by equivalent linearisation (column a) and by numerical integration (column b).
    a1_el, a1_ni, a2_el, a2_ni : float or None, m
        Lateral amplitude of the front and of the rear wheelset by both methods.
    """

    state: int
    V: float
    omega_el: float
    omega_ni: float | None
    a1_el: float | None
    a1_ni: float | None
    a2_el: float | None
    a2_ni: float | None


# State 1 is the linear critical speed; 2 and 3 are unstable; the printed speed of state 6 does not fit its row.
TABLE_1 = (
    State(1, 91.00, 26.96, None, None, None, None, None),
    State(2, 90.00, 27.01, None, 0.0094, None, 0.0085, None),
    State(3, 87.75, 27.22, None, 0.0099, None, 0.0091, None),
    State(4, 90.00, 28.42, 28.1, 0.0104, 0.0100, 0.0097, 0.0094),
    State(5, 90.88, 28.70, 27.91, 0.0105, 0.0101, 0.0098, 0.0095),
    State(6, 92.22, 30.04, 27.91, 0.0110, 0.0102, 0.0103, 0.0097),
    State(7, 100.86, 32.50, 31.40, 0.0120, 0.0112, 0.0111, 0.0106),
    State(8, 112.64, 36.19, 34.89, 0.0140, 0.0127, 0.0129, 0.0118),
    State(9, 127.81, 39.55, 38.06, 0.0170, 0.0153, 0.0153, 0.0138),
    State(10, 141.78, 41.55, 40.52, 0.0200, 0.0182, 0.0177, 0.0160),
    State(11, 150.78, 42.46, 42.87, 0.0220, 0.0203, 0.0193, 0.0176),
    State(12, 159.53, 43.16, 43.31, 0.0240, 0.0223, 0.0208, 0.0193),
    State(13, 172.11, 43.92, 43.31, 0.0270, 0.0256, 0.0231, 0.0218),
    State(14, 184.46, 44.48, 43.31, 0.0300, 0.0289, 0.0253, 0.0243),
)
