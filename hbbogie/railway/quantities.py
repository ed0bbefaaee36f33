"""Quantities by which running stability is judged, as outputs, and limits on them, as lines of a figure.

The limits are given as the open literature quotes them. They were not compared with the text of the standards: check
them against the edition that applies before anything is accepted by them. Standards filter and use windows of time. A
cycle repeats itself: the root mean square over its period takes the place of the window, and `Signal.rms_about` that
of the band-pass filter.
"""

from __future__ import annotations

from math import radians, tan

from hbbogie.errors import ModelError, as_number, door, positive, told
from hbbogie.model.outputs import Output
from hbbogie.model.ramps import Scalar
from hbbogie.model.scalars import as_expression
from hbbogie.model.symbols import Coordinate
from hbbogie.results import LimitLine

CHECK = "As quoted in the literature; to be checked against the standard."
GRAVITY = 9.80665  # m/s2


@door(lateral=Coordinate, yaw=Coordinate)
def frame_acceleration(name: str, lateral: Coordinate, yaw: Coordinate, ahead: Scalar = 0.0) -> Output:
    """Return the lateral acceleration of a bogie frame at a distance ahead of its centre [m/s2].

    Parameters
    ----------
    name : str
    lateral, yaw : Coordinate
        Of the frame, in m and rad.
    ahead : scalar, m
        Half the wheelbase for the place above the front wheelset, its negative above the rear one.
    """
    return Output(name, lateral.ddot + ahead * yaw.ddot, "m/s2", "lateral acceleration of the frame")


def guiding_forces(name: str, *forces: Scalar) -> Output:
    """Return the sum of the guiding forces of a wheelset, what the rails exert on it laterally [N].

    Parameters
    ----------
    name : str
    *forces : scalar expression, N
        Lateral creep forces and flange forces on both wheels.
    """
    if not forces:
        raise ModelError(f"guiding_forces {name!r}: got no forces; give the lateral forces on both wheels.")
    total = sum(as_expression(f"guiding_forces {name!r}", force) for force in forces)
    return Output(name, total, "N", "sum of the guiding forces of the wheelset")


def derailment_quotient(name: str, guiding: Scalar, wheel_load: Scalar) -> Output:
    """Return the quotient Y/Q of the guiding force and the vertical load of a wheel [1].

    Parameters
    ----------
    name : str
    guiding, wheel_load : scalar expression, N
        A model without vertical motion has a constant wheel load: give it a parameter.
    """
    Y, Q = (as_expression(f"derailment_quotient {name!r}", force) for force in (guiding, wheel_load))
    return Output(name, Y / Q, "1", "guiding force over wheel load")


def frame_acceleration_limit(bogie_mass: float) -> LimitLine:
    """Return the limit on the rms of the lateral acceleration of a bogie frame, (12 - m/5)/2 with m in t [m/s2].

    Parameters
    ----------
    bogie_mass : float, kg
        With its wheelsets.

    References
    ----------
    EN 14363 and UIC 518, simplified method, instability criterion; about the frequency of the instability +-2 Hz.
    """
    value = (12 - positive("frame_acceleration_limit: bogie_mass", bogie_mass, "kg") / 5e3) / 2
    if value <= 0:
        raise ModelError(f"frame_acceleration_limit: got {bogie_mass:g} kg, for which there is no limit; give kg.")
    return LimitLine(value, "limit of EN 14363 (to be checked)", "m/s2", f"(12 - m/5)/2 with m in t. {CHECK}")


def guiding_forces_limit(wheelset_load: float, factor: float = 1.0) -> LimitLine:
    """Return the limit on the rms of the sum of guiding forces, factor (10 kN + P/3)/2 [N].

    Parameters
    ----------
    wheelset_load : float, N
        Static vertical load P of the wheelset on the rails.
    factor : float
        1 for locomotives and coaches, 0.85 for freight wagons.

    References
    ----------
    EN 14363 and UIC 518, normal method, instability criterion: half the limit on the lateral shift of the track, which
    is that of Prud'homme.
    """
    load = positive("guiding_forces_limit: wheelset_load", wheelset_load, "N")
    value = positive("guiding_forces_limit: factor", factor, "1") * (10e3 + load / 3) / 2
    return LimitLine(value, "limit of EN 14363 (to be checked)", "N", f"k (10 kN + P/3)/2. {CHECK}")


def flange_climb_limit(angle: float = 70.0, friction: float = 0.6) -> LimitLine:
    """Return Nadal's limit on Y/Q, (tan a - mu)/(1 + mu tan a) [1].

    Parameters
    ----------
    angle : float, deg
        Flange angle a.
    friction : float
        Coefficient of friction mu.

    References
    ----------
    M. J. Nadal, Theorie de la stabilite des locomotives, Annales des Mines 10 (1896) 232-255. Quoted of EN 14363 is 0.8
    for a flange of 70 degrees; the formula gives 0.81 there with the default friction. 49 CFR 213.333 takes 0.5.
    """
    degrees, mu = as_number(angle), as_number(friction)
    if not (0 < degrees < 90 and 0 <= mu < tan(radians(degrees))):
        raise ModelError(
            f"flange_climb_limit: got an angle of {told(angle)} deg and a friction of {told(friction)}; give an angle "
            "between 0 and 90 deg and a friction from 0 to below its tangent."
        )
    slope = tan(radians(degrees))
    return LimitLine((slope - mu) / (1 + mu * slope), "Nadal's limit (to be checked)", "1", CHECK)


def hunting_limit_fra() -> LimitLine:
    """Return the limit of the FRA on the rms of the lateral acceleration of a truck, 0.3 g [m/s2].

    References
    ----------
    49 CFR 213.333, vehicle/track interaction safety limits: truck lateral acceleration over two seconds, mean removed.
    """
    text = "limit of 49 CFR 213.333 (to be checked)"
    return LimitLine(0.3 * GRAVITY, text, "m/s2", f"0.3 g. {CHECK}")
