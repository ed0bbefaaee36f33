"""The simple bogie: a rigid frame on two wheelsets, nonlinear creep and a smooth flange, two degrees of freedom.

A rigid frame carries two wheelsets without springs between them. The bogie runs at constant speed V on straight, level
track and has two coordinates, its lateral displacement q1 and its yaw q2. The wheelsets sit at +-ha from the centre:

    m q1'' + 2 D2 q1' + 2 k4 q1 + 2 (Fy1 + Fy2) + FT(q1 + ha q2) + FT(q1 - ha q2) = 0
    I q2'' + k6 q2 + 2 ha (Fy1 - Fy2) + 2 a (Fx1 + Fx2) + ha (FT(q1 + ha q2) - FT(q1 - ha q2)) = 0

Fx and Fy are the creep forces of one wheel after Vermeulen and Johnson. The flange force FT begins as an exponential
and goes on as a straight line, once differentiable where they meet.

Source: the two-coordinate bogie of H. True and co-workers, which simplifies that of N. K. Cooperrider, The hunting
behavior of conventional railway trucks, Journal of Engineering for Industry 94 (1972) 752-762. Here the shape factor
0.60252 goes with the lateral and 0.54219 with the longitudinal creepage; Kaas-Petersen (1986) has them the other way
round. The numbers in `CYCLES` were computed for these parameters independently of this package, by integration in time.
Assumptions: small angles, no spin, no gravity stiffness, equal wheels.

Symbols: q1 [m] lateral; q2 [rad] yaw; V [m/s] speed; m [kg], I [kg m2] mass and yaw inertia; ha [m] half the
wheelbase; D2 [N s/m] damper, k4 [N/m] and k6 [N m] springs of the secondary suspension; a [m] half the distance of the
contact points; lam [1] conicity; r0 [m] wheel radius; C [N] pi a b G of the contact ellipse; muN [N] friction limit
of a wheel; k0 [N/m] flange stiffness.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from hbbogie import Coordinate, Element, Output, Parameter, System
from hbbogie.railway import VermeulenJohnson, frame_acceleration, guiding_forces


@dataclass(frozen=True, eq=False)
class SmoothFlange:
    """The flange force, odd: exp(-alpha/(x - xf)) - beta - kappa x for 0 <= x < b1, and k0 (x - delta) beyond."""

    k0: Any
    alpha: float = 0.1474128791e-3
    beta: float = 1.016261260
    kappa: float = 1.793756792
    xf: float = 0.9138788366e-2
    b1: float = 0.910685e-2
    delta: float = 0.0091

    def force(self, u: Any) -> Any:
        """Return the force [N] at the displacement u [m]."""
        x = ca.fabs(u)
        inside = ca.fmin(x, self.b1)  # the exponential has a pole at xf, beyond b1
        near = ca.exp(-self.alpha / (inside - self.xf)) - self.beta - self.kappa * inside
        return ca.sign(u) * ca.if_else(x < self.b1, near, self.k0 * (x - self.delta))


def simple_bogie(flange: bool = True, **parameters: float) -> System:
    """Return the bogie.

    Parameters
    ----------
    flange : bool
        Whether the flanges act.
    **parameters : float
        Parameter values that replace the defaults, by name, in the units listed above.
    """
    q1, q2 = Coordinate("q1", "m", "lateral"), Coordinate("q2", "rad", "yaw")

    positive, any_sign = (1e-12, 1e15), (0.0, 1e15)
    V = Parameter("V", 70.0, "m/s", "speed", (1.0, 400.0))
    m = Parameter("m", 4963.0, "kg", "mass of frame and wheelsets", positive)
    I = Parameter("I", 8135.0, "kg m2", "yaw inertia of frame and wheelsets", positive)
    ha = Parameter("ha", 1.074, "m", "half the wheelbase", positive)
    D2 = Parameter("D2", 29200.0, "N s/m", "lateral secondary damping", any_sign)
    k4 = Parameter("k4", 0.1823e6, "N/m", "lateral secondary stiffness", any_sign)
    k6 = Parameter("k6", 2.71e6, "N m", "yaw secondary stiffness", any_sign)
    a = Parameter("a", 0.716, "m", "half the distance of the contact points", positive)
    lam = Parameter("lam", 0.05, "1", "conicity", any_sign)
    r0 = Parameter("r0", 0.4572, "m", "wheel radius", positive)
    C = Parameter("C", 6.563e6, "N", "pi a b G of the contact ellipse", positive)
    muN = Parameter("muN", 10e3, "N", "friction limit of a wheel", positive)
    k0 = Parameter("k0", 14.60e6, "N/m", "flange stiffness", any_sign)

    creep = VermeulenJohnson(C, muN, psi=0.54219, phi=0.60252)

    def contact(side: int) -> tuple[Any, Any, Any]:
        """Return a wheel's resistances Fx and Fy and its loss per metre [N], front (+1) or rear (-1) wheelset."""
        longitudinal = a * q2.dot / V + lam / r0 * (q1 + side * ha * q2)
        lateral = q1.dot / V - q2 + side * ha * q2.dot / V
        on_wheel = creep.force(longitudinal, lateral)
        lost = -(longitudinal * on_wheel[0] + lateral * on_wheel[1])
        return -on_wheel[0], -on_wheel[1], lost

    (Fx1, Fy1, lost1), (Fx2, Fy2, lost2) = contact(1), contact(-1)
    FT1 = Element("front flange", SmoothFlange(k0), q1 + ha * q2)
    FT2 = Element("rear flange", SmoothFlange(k0), q1 - ha * q2)
    lateral = m * q1.ddot + 2 * D2 * q1.dot + 2 * k4 * q1 + 2 * (Fy1 + Fy2)
    yaw = I * q2.ddot + k6 * q2 + 2 * ha * (Fy1 - Fy2) + 2 * a * (Fx1 + Fx2)
    if flange:
        equations, elements = [lateral + FT1 + FT2, yaw + ha * (FT1 - FT2)], [FT1, FT2]
    else:
        equations, elements = [lateral, yaw], []
    outputs = [frame_acceleration("frame acceleration", q1, q2)]
    for where, side, FT, Fy, lost in (("front", 1, FT1, Fy1, lost1), ("rear", -1, FT2, Fy2, lost2)):
        outputs += [
            frame_acceleration(f"frame acceleration, {where}", q1, q2, side * ha),
            guiding_forces(f"guiding forces, {where}", 2 * Fy, *([FT] if flange else [])),
            *([Output(f"flange force, {where}", FT, "N", "without the creep forces")] if flange else []),
            Output(f"wear number, {where}", 2 * lost, "N", "T gamma of both wheels, energy lost per metre"),
        ]
    system = System(
        "simple bogie",
        [q1, q2],
        [V, m, I, ha, D2, k4, k6, a, lam, r0, C, muN, *([k0] if flange else [])],
        equations,
        elements,
        description="rigid bogie with nonlinear creep, two coordinates",
        outputs=outputs,
    )
    return system.with_parameters(**parameters)


SYSTEM = simple_bogie
PARAMETER = "V"
RANGE = (50.0, 140.0)


@dataclass(frozen=True)
class Cycle:
    """A stable cycle.

    Attributes
    ----------
    V : float, m/s
    q1 : float, m
        Largest lateral displacement.
    omega : float, rad/s
    """

    V: float
    q1: float
    omega: float


HOPF = (66.7408, 14.3392)  # V [m/s], omega [rad/s]
FOLD = Cycle(63.874, 0.008624, 13.618)  # V +-0.002
CYCLES = (
    Cycle(64.0, 0.008671, 13.636),
    Cycle(66.0, 0.008838, 13.927),
    Cycle(68.0, 0.008976, 14.201),
    Cycle(70.0, 0.009087, 14.516),
    Cycle(80.0, 0.009444, 16.531),
    Cycle(100.0, 0.010124, 20.546),
    Cycle(120.0, 0.010839, 24.471),
    Cycle(140.0, 0.011643, 28.610),
)
FLANGELESS_FOLD = 57.43
FLANGELESS_CYCLES = (
    Cycle(64.0, 0.038108, 12.954),
    Cycle(70.0, 0.038729, 13.537),
    Cycle(100.0, 0.037400, 15.499),
    Cycle(140.0, 0.034871, 16.662),
)
