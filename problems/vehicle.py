"""Hunting of a railway vehicle: a car body on two bogies, seventeen coordinates.

A vehicle runs at constant speed V on straight, level, perfect track. x points forwards, y to the left, yaw turns x
towards y, roll moves the top towards y. Bogie frame i = 1 (front), 2 (rear) carries the wheelsets 1, 2 and 3, 4:

    yc, pc, rc              car body: lateral, yaw, roll
    yb1, pb1, rb1, yb2 ...  frames: lateral, yaw, roll
    y1, p1, ... y4, p4      wheelsets from the front: lateral, yaw

With s_i = +1 (front), -1 (rear) and z_k = +1 for the leading wheelset of a frame, -1 for the trailing one:

    D_i = yc + s_i lc pc - hc rc - yb_i - hs rb_i        stretch of the lateral secondary suspension
    S_i = 2 ksy D_i + 2 csy D_i'                          its force
    Z_i = 2 ksx bs^2 (pc - pb_i) + yd_i by F_i            yaw moment, F_i the force of each of its yd_i yaw dampers
    X_i = (2 ksz bs^2 + karb)(rc - rb_i) + 2 csz bs^2 (rc' - rb_i')
    E_k = y_k - yb_i - z_k lb pb_i + hp rb_i              stretch of the lateral primary suspension
    A_k = 2 kpy E_k + 2 cpy E_k'
    B_k = 2 kpx bp^2 (p_k - pb_i) + 2 cpx bp^2 (p_k' - pb_i')
    P_i = 4 kpz bp^2 rb_i + 4 cpz bp^2 rb_i'

    mc  yc''   = - S_1 - S_2
    Icz pc''   = - lc S_1 + lc S_2 - Z_1 - Z_2
    Icx rc''   = + hc S_1 + hc S_2 - X_1 - X_2
    mb  yb_i'' = + S_i + A_k + A_k+1
    Ibz pb_i'' = + Z_i + lb (A_k - A_k+1) + B_k + B_k+1
    Ibx rb_i'' = + hs S_i + X_i - hp (A_k + A_k+1) - P_i
    mw  y_k''  = - A_k + 2 Fy_k - FT_k
    Iwz p_k''  = - B_k + 2 a Fx_k

Fx_k, Fy_k are the creep forces on a wheel, linear or of Shen, Hedrick and Elkins; FT_k is the flange, a spring behind a
gap. A yaw damper has the slope c1 up to its blow-off force Fb and c2 beyond, either alone or in series with a spring
kyd, whose deflection then leaves one more coordinate a frame, x1 and x2, of first order. Two dampers act on a frame,
yd_i = 2, one a side; yd_i = 1 is a frame with a failed one, whose other one also pulls the frame lengthwise, a motion
that is not modelled.

Source: masses, lengths and suspension of the vehicle 1 of the Manchester benchmarks (S. Iwnicki, Manchester benchmarks
for rail vehicle simulation, Vehicle System Dynamics 30, 1998, 295-313), as printed in a public data file of it. Flange
stiffness: C. Kaas-Petersen, Acta Mechanica 61 (1986) 89-107. Conicity, creep coefficients, friction limit, clearance
and yaw dampers are typical figures, chosen for this example.
Assumptions: small angles, no spin, no gravity stiffness, no pendulum of the car body, no bump stops, no vertical
motion.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np

import hbbogie as hb
from hbbogie import Branch, Coordinate, Element, ModelError, Output, Parameter, System
from hbbogie.model import DeadBand, Saturation
from hbbogie.parallel import each
from hbbogie.railway import LinearKalker, ShenHedrickElkins, derailment_quotient, frame_acceleration, guiding_forces
from hbbogie.reports import Report, Table, by_mode, draw
from hbbogie.results import Critical

CREEP = ("she", "linear")
YAW_DAMPERS = ("direct", "series", "none")
NO_MOTION = (0.0, 0.0, 0.0)


def vehicle(bogies: int = 2, creep: str = "she", yaw_dampers: str = "direct", **parameters: float) -> System:
    """Return the vehicle.

    Parameters
    ----------
    bogies : int
        2, or 1 for the front bogie alone, under a car body that does not move sideways.
    creep : {"she", "linear"}
        Creep forces of Shen, Hedrick and Elkins, or of Kalker's linear theory.
    yaw_dampers : {"direct", "series", "none"}
        Whether the yaw dampers act directly or in series with a spring.
    **parameters : float
        Parameter values that replace the defaults, by name, in the units of `data`. Without slope, c1 = 0, direct yaw
        dampers do not act.

    Raises
    ------
    ModelError
        For another choice, and for yaw dampers in series with a spring of which one is zero.
    """
    if bogies not in (1, 2):
        raise ModelError(f"vehicle: bogies = {bogies!r}; give 1 or 2.")
    if yaw_dampers == "series" and 0 in (parameters.get("kyd"), parameters.get("c1")):
        raise ModelError(
            "vehicle: a yaw damper in series with a spring does not act where one of both, kyd or c1, is 0, and its "
            "stroke is anything; give yaw_dampers = 'none' for failed ones."
        )
    p = data(creep, yaw_dampers)
    built = car(p) if bogies == 2 else bogie(p, NO_MOTION, NO_MOTION, 1)
    used = [value for name, value in vars(p).items() if bogies == 2 or name not in CAR_BODY]
    system = System(
        "vehicle" if bogies == 2 else "bogie of a vehicle",
        built.coordinates,
        used,
        built.equations,
        built.elements,
        description=f"railway vehicle, creep {creep}, yaw dampers {yaw_dampers}",
        outputs=built.outputs,
    )
    return system.with_parameters(**parameters)


@dataclass(frozen=True)
class Assembly:
    """Bodies that hang together.

    Attributes
    ----------
    coordinates : list of Coordinate
    equations : list of expressions
        One for each coordinate, each equal to zero.
    elements : list of Element
    load : tuple of expressions
        Lateral force S, yaw moment Z and roll moment X with which a bogie pulls at the car body.
    outputs : list of Output
    """

    coordinates: list[Coordinate]
    equations: list[Any]
    elements: list[Element]
    load: tuple[Any, Any, Any] = NO_MOTION
    outputs: list[Output] = field(default_factory=list)


def car(p: SimpleNamespace, mark: str = "") -> Assembly:
    """Return a car body on two bogies; ``mark`` ends the names of its coordinates.

    The first two coordinates, and equations, are those of the lateral displacement and the yaw of the car body.
    """
    yc, pc, rc = body("c", mark, "car body")
    over = [(yc + s * p.lc * pc - p.hc * rc, pc, rc) for s in (1, -1)]
    rates = [(yc.dot + s * p.lc * pc.dot - p.hc * rc.dot, pc.dot, rc.dot) for s in (1, -1)]
    front, rear = (bogie(p, over[i], rates[i], i + 1, mark) for i in (0, 1))
    (S1, Z1, X1), (S2, Z2, X2) = front.load, rear.load
    equations = [
        p.mc * yc.ddot + S1 + S2,
        p.Icz * pc.ddot + p.lc * (S1 - S2) + Z1 + Z2,
        p.Icx * rc.ddot - p.hc * (S1 + S2) + X1 + X2,
    ]
    return Assembly(
        [yc, pc, rc, *front.coordinates, *rear.coordinates],
        [*equations, *front.equations, *rear.equations],
        [*front.elements, *rear.elements],
        outputs=[*front.outputs, *rear.outputs],
    )


def bogie(p: SimpleNamespace, over: tuple[Any, ...], rates: tuple[Any, ...], i: int, mark: str = "") -> Assembly:
    """Return bogie i = 1, 2.

    Parameters
    ----------
    p : namespace of Parameter
    over, rates : tuple of expressions
        Lateral displacement, yaw and roll of the car body above the bogie, and their rates.
    i : int
    mark : str
    """
    u, pc, rc = over
    u_dot, pc_dot, rc_dot = rates
    where = ("front", "rear")[i - 1]
    group = f"{where} bogie" + (f" of vehicle {mark[1:]}" if mark else "")
    yb, pb, rb = frame = body(f"b{i}", mark, f"{where} frame", group)
    S = 2 * p.ksy * (u - yb - p.hs * rb) + 2 * p.csy * (u_dot - yb.dot - p.hs * rb.dot)
    F, series, dampers = yaw_damper(p, pc - pb, pc_dot - pb.dot, f"{i}{mark}")
    stroke = series[0][0].dot if series else p.by * (pc_dot - pb.dot) if dampers else 0.0
    lost = 2 * p.csy * (u_dot - yb.dot - p.hs * rb.dot) ** 2 + 2 * p.csz * p.bs**2 * (rc_dot - rb.dot) ** 2
    acting = getattr(p, f"yd{i}", 0.0)
    lost += 4 * p.cpz * p.bp**2 * rb.dot**2 + acting * F * stroke
    Z = 2 * p.ksx * p.bs**2 * (pc - pb) + (acting * p.by * F if dampers else 0.0)
    X = (2 * p.ksz * p.bs**2 + p.karb) * (rc - rb) + 2 * p.csz * p.bs**2 * (rc_dot - rb.dot)
    P = 4 * p.kpz * p.bp**2 * rb + 4 * p.cpz * p.bp**2 * rb.dot

    wheelsets, equations, flanges, A, B = [], [], [], [], []
    frame_at = f"{where} frame acceleration"
    slid = driven = 0.0
    outputs = [
        frame_acceleration(f"{frame_at}{mark}", yb, pb),
        frame_acceleration(f"{frame_at}, outer{mark}", yb, pb, p.lb if i == 1 else -p.lb),
    ]
    for k, z in ((2 * i - 1, 1), (2 * i, -1)):
        y, psi = body(f"{k}", mark, f"wheelset {k}", group)[:2]
        E, E_dot = y - yb - z * p.lb * pb + p.hp * rb, y.dot - yb.dot - z * p.lb * pb.dot + p.hp * rb.dot
        Ak = 2 * p.kpy * E + 2 * p.cpy * E_dot
        Bk = 2 * p.kpx * p.bp**2 * (psi - pb) + 2 * p.cpx * p.bp**2 * (psi.dot - pb.dot)
        (xi, eta), (Fx, Fy) = contact(p, y, psi)
        FT = Element(f"flange {k}{mark}", DeadBand(p.K0, p.y0), y)
        equations += [p.mw * y.ddot + Ak - 2 * Fy + FT, p.Iwz * psi.ddot + Bk - 2 * p.a * Fx]
        wheelsets += [y, psi]
        flanges, A, B = [*flanges, FT], [*A, Ak], [*B, Bk]
        wear = -2 * (Fx * xi + Fy * eta)  # both wheels
        lost += 2 * p.cpy * E_dot**2 + 2 * p.cpx * p.bp**2 * (psi.dot - pb.dot) ** 2
        slid += p.V * wear
        driven -= 2 * p.V * (Fx * p.lam * y / p.r0 - Fy * psi)
        outputs += [
            guiding_forces(f"guiding forces {k}{mark}", -2 * Fy, FT),
            derailment_quotient(f"Y/Q {k}{mark}", FT - Fy, p.Q),
            Output(f"flange force {k}{mark}", FT, "N", "of the rail on the wheelset, without the creep forces"),
            Output(f"wear number {k}{mark}", wear, "N", "T gamma of both wheels, energy lost per metre"),
        ]
    outputs += [
        Output(f"{where} damper power{mark}", lost, "W", "lost in all dampers of the bogie"),
        Output(f"{where} creep power{mark}", slid, "W", "lost in the contacts of the bogie"),
        Output(f"{where} power of the forward motion{mark}", driven, "W", "that keeps the hunting going"),
    ]
    frame_equations = [
        p.mb * yb.ddot - S - A[0] - A[1],
        p.Ibz * pb.ddot - Z - p.lb * (A[0] - A[1]) - B[0] - B[1],
        p.Ibx * rb.ddot - p.hs * S - X + p.hp * (A[0] + A[1]) + P,
    ]
    coordinates = [*frame, *wheelsets, *(x for x, _ in series)]
    return Assembly(
        coordinates, [*frame_equations, *equations, *(r for _, r in series)], [*dampers, *flanges], (S, Z, X), outputs
    )


def yaw_damper(
    p: SimpleNamespace, angle: Any, rate: Any, name: str
) -> tuple[Any, list[tuple[Coordinate, Any]], list[Element]]:
    """Return the force of one yaw damper [N], its own coordinate with its equation, if any, and its element.

    Parameters
    ----------
    p : namespace of Parameter
        Without ``by`` there are no yaw dampers; with ``kyd`` each has a spring in series.
    angle, rate : expression
        Yaw of the car body against the frame [rad], and its rate [rad/s].
    name : str
    """
    if "by" not in vars(p):
        return 0.0, [], []
    if "kyd" not in vars(p):
        direct = Element(f"yaw damper {name}", Saturation(p.c1, p.Fb, beyond=p.c2), p.by * rate)
        return direct, [], [direct]
    x = Coordinate(f"x{name}", "m", f"stroke of the yaw dampers {name}")
    F = p.kyd * (p.by * angle - x)
    faster = Element(f"yaw damper {name}", DeadBand(1 / p.c2 - 1 / p.c1, p.Fb), F)  # beyond blow-off [m/s]
    return F, [(x, x.dot - F / p.c1 - faster)], [faster]


def contact(p: SimpleNamespace, y: Coordinate, psi: Coordinate) -> tuple[tuple[Any, Any], tuple[Any, Any]]:
    """Return the longitudinal and the lateral creepage [1], and the creep forces on a wheel [N]."""
    law = ShenHedrickElkins(p.f11, p.f22, p.muN) if "muN" in vars(p) else LinearKalker(p.f11, p.f22)
    xi, eta = p.a * psi.dot / p.V + p.lam * y / p.r0, y.dot / p.V - psi
    return (xi, eta), law.force(xi, eta)


def body(name: str, mark: str, what: str, group: str = "") -> list[Coordinate]:
    """Return lateral displacement, yaw and roll of a body."""
    motions = (("y", "m", "lateral"), ("p", "rad", "yaw"), ("r", "rad", "roll"))
    return [Coordinate(f"{q}{name}{mark}", unit, f"{what}, {motion}", group=group) for q, unit, motion in motions]


def data(creep: str = "she", yaw_dampers: str = "direct") -> SimpleNamespace:
    """Return the parameters by name; arguments as of `vehicle`."""
    for what, given, known in (("creep", creep, CREEP), ("yaw_dampers", yaw_dampers, YAW_DAMPERS)):
        if given not in known:
            raise ModelError(f"vehicle: {what} = {given!r}; give one of {', '.join(known)}.")
    positive, any_sign = (1e-12, 1e15), (0.0, 1e15)
    found = [
        Parameter("V", 70.0, "m/s", "speed", (1.0, 400.0)),
        Parameter("mc", 32000.0, "kg", "mass of the car body", positive),
        Parameter("Icz", 1.97e6, "kg m2", "yaw inertia of the car body", positive),
        Parameter("Icx", 56800.0, "kg m2", "roll inertia of the car body", positive),
        Parameter("mb", 2615.0, "kg", "mass of a frame", positive),
        Parameter("Ibz", 3067.0, "kg m2", "yaw inertia of a frame", positive),
        Parameter("Ibx", 1722.0, "kg m2", "roll inertia of a frame", positive),
        Parameter("mw", 1813.0, "kg", "mass of a wheelset", positive),
        Parameter("Iwz", 1120.0, "kg m2", "yaw inertia of a wheelset", positive),
        Parameter("kpx", 31.391e6, "N/m", "longitudinal primary stiffness, an axle box", any_sign),
        Parameter("kpy", 3.884e6, "N/m", "lateral primary stiffness, an axle box", any_sign),
        Parameter("kpz", 1.22e6, "N/m", "vertical primary stiffness, an axle box", any_sign),
        Parameter("cpx", 15e3, "N s/m", "longitudinal primary damping, an axle box", any_sign),
        Parameter("cpy", 2e3, "N s/m", "lateral primary damping, an axle box", any_sign),
        Parameter("cpz", 4e3, "N s/m", "vertical primary damping, an axle box", any_sign),
        Parameter("ksx", 0.16e6, "N/m", "longitudinal secondary stiffness, a side", any_sign),
        Parameter("ksy", 0.16e6, "N/m", "lateral secondary stiffness, a side", any_sign),
        Parameter("ksz", 0.43e6, "N/m", "vertical secondary stiffness, a side", any_sign),
        Parameter("csy", 32e3, "N s/m", "lateral secondary damping, a side", any_sign),
        Parameter("csz", 20e3, "N s/m", "vertical secondary damping, a side", any_sign),
        Parameter("karb", 0.94e6, "N m/rad", "anti-roll bar, a bogie", any_sign),
        Parameter("lc", 9.5, "m", "half the distance of the bogies", positive),
        Parameter("lb", 1.28, "m", "half the wheelbase of a bogie", positive),
        Parameter("bp", 1.0, "m", "half the lateral spacing of the primary suspension", positive),
        Parameter("bs", 1.0, "m", "half the lateral spacing of the secondary suspension", positive),
        Parameter("hc", 0.9725, "m", "height from secondary suspension to car body centre"),
        Parameter("hs", 0.2275, "m", "height from frame centre to secondary suspension"),
        Parameter("hp", 0.14, "m", "height from primary suspension to frame centre"),
        Parameter("r0", 0.46, "m", "wheel radius", positive),
        Parameter("a", 0.75, "m", "half the distance of the rolling circles", positive),
        Parameter("lam", 0.2, "1", "conicity", any_sign),
        Parameter("f11", 9.4e6, "N", "longitudinal creep coefficient, a wheel", any_sign),
        Parameter("f22", 8.7e6, "N", "lateral creep coefficient, a wheel", any_sign),
        Parameter("K0", 14.6e6, "N/m", "flange stiffness", any_sign),
        Parameter("y0", 0.008, "m", "flange clearance", positive),
        Parameter("Q", 54.5e3, "N", "wheel load, of Y/Q only", positive),
    ]
    if creep == "she":
        found.append(Parameter("muN", 16.4e3, "N", "friction limit, a wheel: friction times its load", positive))
    if yaw_dampers != "none":
        slope = any_sign if yaw_dampers == "direct" else positive
        found += [
            Parameter("by", 1.3, "m", "half the spacing of the yaw dampers", positive),
            Parameter("c1", 200e3, "N s/m", "slope of a yaw damper below blow-off", slope),
            Parameter("Fb", 6e3, "N", "blow-off force of a yaw damper", any_sign),
            Parameter("c2", 10e3, "N s/m", "slope of a yaw damper beyond blow-off", slope),
            Parameter("yd1", 2.0, "1", "yaw dampers that act on the front frame", (0.0, 4.0)),
            Parameter("yd2", 2.0, "1", "yaw dampers that act on the rear frame", (0.0, 4.0)),
        ]
    if yaw_dampers == "series":
        found.append(Parameter("kyd", 5e6, "N/m", "series stiffness of a yaw damper", positive))
    return SimpleNamespace(**{one.name: one for one in found})


CAR_BODY = ("mc", "Icz", "Icx", "lc", "hc", "yd2")  # and the second bogie
SYSTEM = vehicle
PARAMETER = "V"
RANGE = (40.0, 110.0)
HARMONICS, RESOLVED, JUDGED = 9, 31, 24  # along the branches, where they are judged, and how many cycles of each are


def study(system: System, progress: Callable[[str, float | None], None]) -> Report:
    """Return the critical speeds, and the branch of each attractor with the stability of its cycles."""
    found = hb.critical_speeds(system, PARAMETER, RANGE, progress=progress)
    attractors = [(moves or "all", fold) for moves, fold in found.lowest.items()]
    judged = each(_attractor, (system, list(found.branches)), attractors, progress, "branches of the attractors")
    branches = {moves: branch for (moves, _), branch in zip(attractors, judged, strict=True)}
    rows = [(c.kind, c.value, c.error, c.omega, c.moves) for c in found]
    columns = ("kind", "V [m/s]", "error from harmonics, at most [m/s]", "omega [rad/s]", "moves")
    table = Table("critical", "Critical speeds", columns, tuple(rows), ("", ".8g", ".1e", ".7g", ""))
    shown = [q for q in ("y1", "y3") if q in system.coordinate_names]
    parts, modes = by_mode(system, list(branches.values()))
    options = {"labels": modes, "parameter_label": "speed V [m/s]"}
    figures = {f"attractors_{q}": partial(draw, "branch", parts, y=q, **options) for q in shown}
    notes = [f"{sentence[0].upper()}{sentence[1:]}." for sentence in (*found.evidence, *found.undecided)]
    named = {moves.replace(" ", "_"): branch for moves, branch in branches.items()}
    return Report(system.name, (table,), named, figures if branches else {}, tuple(notes))


def _attractor(
    known: tuple[System, Sequence[Branch]], moves: str, fold: Critical, progress: Callable[[str, float | None], None]
) -> Branch:
    """Return the branch of an attractor, through the fold where it begins, with its stability."""
    system, branches = known
    return _judged(system, _followed(system, branches, fold) or _through(system, fold))


def _followed(system: System, branches: Sequence[Branch], fold: Critical) -> Branch | None:
    """Return the branch of a fold as the search followed it, where it did so beyond the range: up to its end."""
    for branch in branches:
        at, last = (fold.value, fold.omega), float(branch.values[-1])
        near = [s for s in branch.folds() if np.allclose((s.value, s.omega), at, rtol=5e-3, atol=0.0)]
        if near and last > RANGE[1]:
            inside = next(part for part in branch.between(*RANGE) if near[0] in part.special)
            ends = hb.branches.crossings(hb.HarmonicBalance(HARMONICS).equations(system), branch, RANGE[1])
            return inside.with_orbits([*inside.orbits, *ends]) if len(ends) == 1 else None
    return None


def _through(system: System, fold: Critical) -> Branch:
    """Return the branch through a fold, from a cycle of a little more amplitude."""
    balance = hb.HarmonicBalance(HARMONICS).equations(system)
    wheelsets = [q for q in ("y1", "y3") if q in system.coordinate_names]
    largest = max(wheelsets, key=fold.orbit.first_harmonic)
    amplitude = {largest: 1.03 * fold.orbit.first_harmonic(largest)}
    start = hb.solve(balance, fold.orbit, free=PARAMETER, amplitude=amplitude)
    return hb.trace(balance, start, PARAMETER, RANGE, stability=False)


def _judged(system: System, branch: Branch) -> Branch:
    """Return a branch by some of its cycles, evenly spread, computed anew with the harmonics that stability takes."""
    fine = hb.HarmonicBalance(RESOLVED).equations(system)
    curve = np.array([branch.values, *(branch.amplitude(q) for q in ("y1", "y3") if q in system.coordinate_names)])
    steps = np.linalg.norm(np.diff(curve / np.ptp(curve, axis=1, keepdims=True)), axis=0)
    way = np.append(0.0, np.cumsum(steps))
    spread = np.searchsorted(way, np.linspace(0.0, way[-1], JUDGED))
    folds = {branch.place(point) for point in branch.folds()}
    judged = []
    for i in sorted({*map(int, spread), *folds}):
        orbit = branch.orbits[i]
        try:
            cycle = hb.solve(fine, orbit, method="newton", V=orbit.parameters["V"])
        except hb.ConvergenceError:  # at a fold, or beside it: which lies elsewhere with more harmonics
            judged += [orbit] if i in folds else []
            continue
        judged.append(cycle.replace(stability=hb.floquet(system, cycle)))
    return branch.with_orbits(judged)
