"""Hunting of Cooperrider's bogie with the creep law of Vermeulen and Johnson, seven coordinates (Kaas-Petersen 1986).

A bogie runs at constant speed V on straight, level, perfect track; the car body does not move laterally. Coordinates
(metres and radians): front wheelset lateral q1 and yaw q2, rear wheelset lateral q3 and yaw q4, frame lateral q5, yaw
q6 and roll q7. The equations are those of the problem yang1995 but for the creep: each wheel has the forces Fx and Fy
of Vermeulen and Johnson, without spin. The flange is a spring behind a gap, and acts as an option.

Source: C. Kaas-Petersen, Chaos in a railway bogie, Acta Mechanica 61 (1986) 89-107. The Hopf point printed there is
68.66 m/s, of a slightly different shear modulus. The numbers in `POINTS` and `CYCLES` were computed for the parameters
below, independently of this package, by Runge-Kutta integration and by harmonic balance.
Assumptions: small angles, equal wheels, no spin, no gravity stiffness.

Symbols: see the parameters below.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from hbbogie import Coordinate, Element, Parameter, System
from hbbogie.model import DeadBand
from hbbogie.railway import VermeulenJohnson, frame_acceleration, guiding_forces


def bogie(flange: bool = True, **parameters: float) -> System:
    """Return the bogie.

    Parameters
    ----------
    flange : bool
        Whether the flanges act.
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
    V = Parameter("V", 80.0, "m/s", "speed", (1.0, 400.0))
    Mw = Parameter("Mw", 1022.0, "kg", "mass of a wheelset", positive)
    Mf = Parameter("Mf", 2918.0, "kg", "mass of the frame", positive)
    Iwy = Parameter("Iwy", 678.0, "kg m2", "yaw inertia of a wheelset", positive)
    Ify = Parameter("Ify", 6780.0, "kg m2", "yaw inertia of the frame", positive)
    Ifr = Parameter("Ifr", 6780.0, "kg m2", "roll inertia of the frame", positive)
    K1 = Parameter("K1", 1.823e6, "N/m", "lateral primary stiffness", any_sign)
    K2 = Parameter("K2", 3.646e6, "N/m", "longitudinal primary stiffness", any_sign)
    K3 = Parameter("K3", 3.646e6, "N/m", "vertical primary stiffness", any_sign)
    K4 = Parameter("K4", 0.1823e6, "N/m", "lateral secondary stiffness", any_sign)
    K5 = Parameter("K5", 0.3333e6, "N/m", "vertical secondary stiffness", any_sign)
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
    r0 = Parameter("r0", 0.4572, "m", "wheel radius", positive)
    C = Parameter("C", 6.563e6, "N", "pi a b G of the contact ellipse", positive)
    muN = Parameter("muN", 10e3, "N", "friction limit of a wheel", positive)
    K0 = Parameter("K0", 14.6e6, "N/m", "flange stiffness", any_sign)
    y0 = Parameter("y0", 0.0091, "m", "flange clearance", positive)

    creep = VermeulenJohnson(C, muN, psi=0.60252, phi=0.54219)

    def contact(y: Coordinate, psi: Coordinate) -> tuple[Any, Any]:
        """Return the resistances Fx and Fy of a wheel [N] of the wheelset with these coordinates."""
        longitudinal = a * psi.dot / V + lam * y / r0
        lateral = y.dot / V - psi
        on_wheel = creep.force(longitudinal, lateral)
        return -on_wheel[0], -on_wheel[1]

    Fx1, Fy1 = contact(q1, q2)
    Fx2, Fy2 = contact(q3, q4)
    A1 = 2 * K1 * (q1 - q5 - b * q6 - h1 * q7)
    A2 = 2 * K1 * (q3 - q5 + b * q6 - h1 * q7)
    A3 = 2 * K2 * d1**2 * (q2 - q6)
    A4 = 2 * K2 * d1**2 * (q4 - q6)
    A5 = 2 * D2 * (q5.dot - h2 * q7.dot) + 2 * K4 * (q5 - h2 * q7)
    A6 = K6 * q6
    A7 = 2 * D1 * d2**2 * q7.dot + 2 * K5 * d2**2 * q7 + 4 * K3 * d1**2 * q7
    front, rear = (Element(f"{where} flange", DeadBand(K0, y0), q) for where, q in (("front", q1), ("rear", q3)))
    flanges = [front, rear] if flange else []
    equations = [
        Mw * q1.ddot + A1 + 2 * Fy1 + (front if flange else 0),
        Iwy * q2.ddot + A3 + 2 * a * Fx1,
        Mw * q3.ddot + A2 + 2 * Fy2 + (rear if flange else 0),
        Iwy * q4.ddot + A4 + 2 * a * Fx2,
        Mf * q5.ddot - A1 - A2 + A5,
        Ify * q6.ddot - b * A1 + b * A2 - A3 - A4 + A6,
        Ifr * q7.ddot - h1 * A1 - h1 * A2 - h2 * A5 + A7,
    ]
    system = System(
        "Kaas-Petersen's bogie",
        [q1, q2, q3, q4, q5, q6, q7],
        [V, Mw, Mf, Iwy, Ify, Ifr, K1, K2, K3, K4, K5, K6, D1, D2, a, b, d1, d2, h1, h2, lam, r0, C, muN]
        + ([K0, y0] if flange else []),
        equations,
        flanges,
        description="railway bogie with nonlinear creep, Kaas-Petersen (1986)",
        outputs=[
            guiding_forces("front guiding forces", 2 * Fy1, *flanges[:1]),
            guiding_forces("rear guiding forces", 2 * Fy2, *flanges[1:]),
            frame_acceleration("frame lateral acceleration", q5, q6),
            frame_acceleration("frame acceleration, front", q5, q6, b),
        ],
    )
    return system.with_parameters(**parameters)


SYSTEM = bogie
PARAMETER = "V"
RANGE = (50.0, 140.0)


@dataclass(frozen=True)
class Cycle:
    """A cycle.

    Attributes
    ----------
    V : float, m/s
    q1, q3 : float, m
        Largest lateral displacement of the front and of the rear wheelset.
    omega : float, rad/s
    """

    V: float
    q1: float
    q3: float
    omega: float


HOPF = (68.64403, 25.12164)  # V [m/s], omega [rad/s]
FOLD = (66.655, 23.877)  # V +-0.001
POINTS = {  # V [m/s] on the branches of symmetric and asymmetric cycles
    "fold of the stable symmetric branch": 110.435,
    "fold of another symmetric branch": 98.11,
    "pitchforks": (98.533, 130.55),
    # By shooting, here and in a script of its own with DOP853, both with the variational equations. Harmonic balance
    # is not resolved there: 21 harmonics have none above 101.9 m/s, 31 have it at 101.98, 47 at 102.17 m/s.
    "Neimark-Sacker": 102.202,
}
CYCLES = (
    Cycle(67, 0.00949, 0.00927, 24.017),
    Cycle(68, 0.00974, 0.00954, 24.376),
    Cycle(70, 0.01019, 0.01002, 25.032),
    Cycle(75, 0.01116, 0.01111, 26.272),
    Cycle(80, 0.01177, 0.01183, 26.638),
    Cycle(88, 0.01238, 0.01253, 26.784),
    Cycle(96, 0.01338, 0.01346, 28.238),
    Cycle(104, 0.01458, 0.01458, 29.398),
    Cycle(108, 0.01515, 0.01502, 29.710),
)
ASYMMETRIC = {110.0: 0.01736, 140.0: 0.01905}  # front peak [m] over V [m/s]
FLANGELESS_FOLD = (50.22, 0.0415, 15.44)  # V [m/s], front peak [m], omega [rad/s]
FLANGELESS = (
    Cycle(68, 0.05081, 0.05736, 14.718),
    Cycle(100, 0.04868, 0.06378, 15.195),
    Cycle(150, 0.04683, 0.07369, 15.543),
)
FLANGELESS_PITCHFORK = (155.9, 156.1)  # between these speeds [m/s]
FLANGELESS_ASYMMETRIC = {"V": 180.0, "q1": (-0.0442, 0.0497), "q3": (-0.0729, 0.0912), "omega": 15.697}
