"""A train of coupled vehicles, seventeen coordinates each.

Each vehicle is that of the problem `vehicle`. Vehicle m leads vehicle m + 1. Between the ends of their car bodies, le
from the centres, acts a coupler with a lateral force Fc and a yaw moment Mc:

    G  = (yc_m - le pc_m) - (yc_m+1 + le pc_m+1)
    Fc = kcy G + ccy G'
    Mc = kcp (pc_m - pc_m+1) + ccp (pc_m' - pc_m+1')

    car m:      mc yc'' gets - Fc,   Icz pc'' gets + le Fc - Mc
    car m + 1:  mc yc'' gets + Fc,   Icz pc'' gets + le Fc + Mc

The coordinates of vehicle m end with _m: y1_2 is the lateral displacement of the first wheelset of the second vehicle.

Source: as of the problem `vehicle`; the coupler is typical, chosen for this example.
Assumptions: as of the problem `vehicle`; all vehicles are alike.
"""

from __future__ import annotations

from itertools import pairwise

from hbbogie import ModelError, Parameter, System, load_problem

VEHICLE = load_problem("vehicle")
MOST = 64  # vehicles; more take minutes for the equations alone


def train(n: int = 2, creep: str = "she", yaw_dampers: str = "direct", **parameters: float) -> System:
    """Return a train.

    Parameters
    ----------
    n : int
        Number of vehicles, at most 64.
    creep, yaw_dampers : str
        As of the vehicle.
    **parameters : float
        Parameter values that replace the defaults, by name, in the units of the vehicle and of the couplers.

    Raises
    ------
    ModelError
        For a number of vehicles that is no whole number from 1 to 64.
    """
    if n not in range(1, MOST + 1):
        raise ModelError(f"train: n = {n!r} vehicles; give a whole number from 1 to {MOST}, such as n=4.")
    n, p = int(n), VEHICLE.data(creep, yaw_dampers)
    any_sign = (0.0, 1e15)
    le = Parameter("le", 12.5, "m", "from the centre of a car body to its coupler", (1e-12, 1e15))
    kcy = Parameter("kcy", 0.2e6, "N/m", "lateral stiffness of a coupler", any_sign)
    ccy = Parameter("ccy", 20e3, "N s/m", "lateral damping of a coupler", any_sign)
    kcp = Parameter("kcp", 0.5e6, "N m", "yaw stiffness of a coupler", any_sign)
    ccp = Parameter("ccp", 0.1e6, "N m s", "yaw damping of a coupler", any_sign)

    cars = [VEHICLE.car(p, f"_{m + 1}") for m in range(n)]
    for front, rear in pairwise(cars):
        (y1, p1), (y2, p2) = front.coordinates[:2], rear.coordinates[:2]
        G, G_dot = (y1 - le * p1) - (y2 + le * p2), (y1.dot - le * p1.dot) - (y2.dot + le * p2.dot)
        Fc = kcy * G + ccy * G_dot
        Mc = kcp * (p1 - p2) + ccp * (p1.dot - p2.dot)
        front.equations[0] += Fc
        front.equations[1] += Mc - le * Fc
        rear.equations[0] -= Fc
        rear.equations[1] -= Mc + le * Fc
    system = System(
        f"train of {n}",
        [q for one in cars for q in one.coordinates],
        [*vars(p).values(), *([le, kcy, ccy, kcp, ccp] if n > 1 else [])],
        [r for one in cars for r in one.equations],
        [e for one in cars for e in one.elements],
        description=f"{n} coupled railway vehicles",
        outputs=[output for one in cars for output in one.outputs],
    )
    return system.with_parameters(**parameters)


SYSTEM = train
PARAMETER = "V"
RANGE = (40.0, 110.0)
