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

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from hbbogie import (
    Branch,
    ConvergenceError,
    Coordinate,
    Element,
    HarmonicBalance,
    Orbit,
    Parameter,
    System,
    floquet,
    hopf_points,
    load_problem,
    solve,
    trace,
)
from hbbogie.branches import ORDERS, crossings, estimate, judged
from hbbogie.model import DeadBand
from hbbogie.motion import settle
from hbbogie.progress import Progress
from hbbogie.reports import Report, Table
from hbbogie.results import SpecialPoint

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hbbogie.methods import Equations


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
    lam = Parameter("lam", 0.05, "1", "conicity lambda", any_sign)
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
    creep = [f11, f22, f23, f33, *([kg] if gravity else [])]
    system = System(
        "Yang's bogie",
        [q1, q2, q3, q4, q5, q6, q7],
        [V, Mw, Mf, Iwy, Ify, Ifr, K0, K1, K2, K3, K4, K5, K6, D1, D2, a, b, d1, d2, h1, h2, lam, W, y0, r0, *creep],
        equations,
        [front, rear],
        description="railway bogie with flange contact, Yang (1995)",
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


# --- the rest of the paper: methods compared, figures 2 to 6, creep coefficients -------------------


def _part(name: str) -> ModuleType:
    return load_problem(Path(__file__).with_name(f"_yang1995_{name}.py"))


def comparison(system: System, methods: Sequence[str], progress: Progress) -> Report:
    """Compare describing functions, the paper's method, multi-harmonic balance and integration, state by state."""
    report: Report = _part("paper").comparison(system, methods, progress)
    return report


def paper(system: System, progress: Progress) -> Report:
    """Draw figures 2 to 6 of the paper from our results."""
    report: Report = _part("paper").paper(system, progress)
    return report


def identification(system: System, progress: Progress, **options: Any) -> Report:
    """Identify the creep coefficients from Table 1, free or by Kalker's theory with one parameter."""
    report: Report = _part("creep").identification(system, progress, **options)
    return report


# --- the main job: Table 1 beside multi-harmonic balance and integration -------------------------

TOLERANCE = 1e-3  # error of frequency and waveform by shooting that decides how many harmonics are taken
TRUTH = 61  # highest harmonic that the others are compared with
PUSHED = {"q1": 0.03, "q3": 0.03}  # m; both wheelsets against the flange, as in Fig. 6 of the paper
EL, NI, MHB, RK4 = "printed EL", "printed NI", "MHB", "RK4"


@dataclass(frozen=True, eq=False)
class StateComparison:
    """One row of Table 1 with what is computed for it.

    Attributes
    ----------
    printed : State
    orbit : Orbit or None
        By multi-harmonic balance, where there is a cycle.
    integrated : (float, float, float) or None
        Frequency [rad/s] and peaks of q1 and q3 [m] by Runge-Kutta integration, where the cycle is stable.
    remark : str
    """

    printed: State
    orbit: Orbit | None
    integrated: tuple[float, float, float] | None
    remark: str


def study(system: System, progress: Progress) -> Report:
    """Compute the branch of hunting cycles and put it beside Table 1 of the paper."""
    progress("equations and Hopf points", 0.0)
    hopf = hopf_points(system, PARAMETER, RANGE)
    if not hopf:
        note = f"No Hopf point between V = {RANGE[0]:g} and {RANGE[1]:g} m/s: no hunting begins there."
        return Report(system.name, notes=(note,))
    progress("branch of hunting cycles and its stability", 0.05)
    for H in ORDERS:
        balance = HarmonicBalance(H).equations(system)
        branch = trace(balance, hopf[0], PARAMETER, RANGE)
        error, resolved = estimate(system, [branch], H, TOLERANCE)
        if error <= TOLERANCE:
            break
    branch = judged(system, branch)
    rows = []
    for i, state in enumerate(TABLE_1):
        progress(f"state {state.state} of Table 1", 0.3 + 0.4 * i / len(TABLE_1))
        rows.append(compare(system, balance, branch, hopf[0], state))
    progress(f"highest harmonics 1 to {TRUTH}", 0.7)
    convergence = harmonic_convergence(system, rows, hopf[0], H)
    tables = (table_of_states(rows, H), table_of_deviations(rows), convergence)
    both = [o.replace(stability=floquet(system, o)) for o in crossings(balance, branch, 90.0)]
    folds = [f"{f.value:.4f} m/s" for f in branch.folds()]
    notes = (
        f"Linear critical speed {hopf[0].value:.3f} m/s, omega {hopf[0].omega:.4f} rad/s "
        f"({hopf[0].omega / (2 * np.pi):.4f} Hz); printed: 91.00 m/s, 26.96 rad/s.",
        f"Nonlinear critical speed (fold) with harmonics up to {H}: {', '.join(folds) or 'none in the range'}. "
        "Below it there is no hunting cycle.",
        f"The branch: {branch.ends[0]}; {branch.ends[1]}.",
        *resolved,
    )
    figures = _figures(branch, hopf[0], both, convergence)
    data = {
        "cycles_at_90": [o.summary() for o in both],
        "hopf": hopf[0].value,
        "folds": [f.value for f in branch.folds()],
    }
    return Report("Limit cycles of Yang's bogie", tables, {"branch": branch}, figures, notes, data)


def compare(system: System, balance: Equations, branch: Branch, hopf: SpecialPoint, state: State) -> StateComparison:
    """Compute what one row of Table 1 prints: at its speed, or at its amplitude where no cycle has that speed."""
    if state.state == 1:
        return StateComparison(state, hopf.orbit, None, "the Hopf point, no flange contact")
    stable = state.a1_ni is not None
    found = sorted(crossings(balance, branch, state.V), key=lambda o: o.amplitude("q1"))
    remark = (
        "the printed speed does not fit its equivalent linearisation (94.2 m/s would); its integration was run at it"
        if state.state == 6
        else ""
    )
    if found:
        orbit = found[-1] if stable else found[0]
        if stable and len(found) == 1 and branch.folds() and hopf.value > state.V:
            remark = remark or "the only cycle at this speed"
    elif state.a1_el is not None:
        fold = f" (fold at {branch.folds()[0].value:.3f} m/s)" if branch.folds() else ""
        a1 = state.a1_el
        nearest = min(branch.orbits, key=lambda o: abs(o.first_harmonic("q1") - a1))
        try:
            orbit = solve(balance, nearest, amplitude={"q1": a1}, free=PARAMETER)
        except ConvergenceError:
            return StateComparison(state, None, None, f"no cycle at this speed{fold} nor with this amplitude")
        remark = f"no cycle at this speed{fold}; here at the printed a1, where V = {orbit.parameters['V']:.3f} m/s"
    else:
        return StateComparison(state, None, None, "no cycle at this speed")
    orbit = orbit.replace(stability=floquet(system, orbit))
    integrated = None
    if stable:
        settled = settle(system, PUSHED, V=state.V)
        if settled.kind == "cycle":
            integrated = (settled.omega, settled.amplitudes["q1"], settled.amplitudes["q3"])
        else:
            remark = f"{remark}; integration: {settled.status}".lstrip("; ")
    return StateComparison(state, orbit, integrated, remark)


def _computed(row: StateComparison) -> tuple[float | None, float | None, float | None]:
    """Return frequency and peaks by multi-harmonic balance; at the Hopf point the amplitude is anything up to y0."""
    if row.orbit is None:
        return None, None, None
    if row.printed.state == 1:
        return row.orbit.omega, None, None
    return row.orbit.omega, row.orbit.amplitude("q1"), row.orbit.amplitude("q3")


def table_of_states(rows: list[StateComparison], H: int) -> Table:
    """Return Table 1 of the paper with our columns beside the printed ones."""
    columns = ["state", "V [m/s]"]
    columns += [f"omega {m} [rad/s]" for m in (EL, NI, MHB, RK4)]
    columns += [f"{a} {m} [mm]" for a in ("a1", "a2") for m in (EL, NI, MHB, RK4)]
    body = []
    for row in rows:
        s, ours, rk4 = row.printed, _computed(row), row.integrated or (None, None, None)
        amplitudes = [s.a1_el, s.a1_ni, ours[1], rk4[1], s.a2_el, s.a2_ni, ours[2], rk4[2]]
        millimetres = [None if a is None else 1e3 * a for a in amplitudes]
        stability = row.orbit.stability.verdict if row.orbit and row.orbit.stability else None
        body.append((s.state, s.V, s.omega_el, s.omega_ni, ours[0], rk4[0], *millimetres, stability))
    formats = ("d", ".2f", ".2f", ".2f", ".3f", ".3f", *[".1f", ".1f", ".3f", ".3f"] * 2, "")
    notes = (
        "EL: equivalent linearisation; NI: numerical integration (its printed frequencies are read off a 5 ms grid). "
        f"MHB: multi-harmonic balance, odd harmonics up to {H}; RK4: our integration, step 1 ms. "
        "a1, a2: peak of the lateral displacement of the front and rear wheelset.",
        *(f"State {r.printed.state}: {r.remark}." for r in rows if r.remark),
    )
    return Table(
        "table1", "Table 1 of Yang (1995), printed and computed", (*columns, "stability"), tuple(body), formats, notes
    )


def table_of_deviations(rows: list[StateComparison]) -> Table:
    """Return the relative deviations of multi-harmonic balance from the printed columns and from our integration."""
    quantities = ("omega", "a1", "a2")
    columns = ("state", *(f"{q} MHB - {m} [%]" for m in (NI, RK4, EL) for q in quantities))
    body = []
    for row in rows:
        s, ours = row.printed, _computed(row)
        printed = (s.omega_ni, s.a1_ni, s.a2_ni), row.integrated or (None,) * 3, (s.omega_el, s.a1_el, s.a2_el)
        entries: list[float | None] = []
        for column in printed:
            pairs = zip(ours, column, strict=True)
            entries += [None if a is None or b is None else 100 * (a / b - 1) for a, b in pairs]
        body.append((s.state, *entries))
    formats = ("d", *[".2f"] * 3, *[".4f"] * 3, *[".2f"] * 3)
    return Table("deviations", "Deviation of multi-harmonic balance", columns, tuple(body), formats)


def harmonic_convergence(system: System, rows: list[StateComparison], hopf: SpecialPoint, taken: int) -> Table:
    """Return how frequency, peaks and fold depend on the highest harmonic, over the stable states of Table 1."""
    stable = [r.orbit for r in rows if r.orbit is not None and r.integrated is not None]
    values: dict[int, list[Any]] = {}
    folds: dict[int, float | None] = {}
    for H in sorted({TRUTH, 1, 3, 5, 9, taken}, reverse=True):
        balance = HarmonicBalance(H).equations(system)
        branch = trace(balance, hopf, PARAMETER, RANGE, stability=False)
        folds[H] = branch.folds()[0].value if branch.folds() else None
        values[H] = []
        for orbit in stable:
            found = crossings(balance, branch, orbit.parameters["V"])
            best = max(found, key=lambda o: o.amplitude("q1"), default=None)
            values[H].append(best and (best.omega, best.amplitude("q1"), best.amplitude("q3")))
    body = []
    for H in sorted(values):
        pairs = [(a, b) for a, b in zip(values[H], values[TRUTH], strict=True) if a and b]
        error = np.array([[100 * abs(x / y - 1) for x, y in zip(a, b, strict=True)] for a, b in pairs])
        worst = error.max(axis=0) if len(pairs) else (None, None, None)
        body.append((H, folds[H], *worst))
    columns = ("highest harmonic", "fold [m/s]", "largest error of omega [%]", "of a1 [%]", "of a2 [%]")
    note = f"Errors against highest harmonic {TRUTH}, the largest over the stable states of Table 1."
    return Table("harmonics", "How many harmonics", columns, tuple(body), ("d", ".4f", ".5f", ".5f", ".5f"), (note,))


# --- figures ----------------------------------------------------------------------------------

SPEED = "speed V [m/s]"
ABOUT = (87.0, 93.0)  # m/s; about the fold


def _figures(
    branch: Branch, hopf: SpecialPoint, cycles: list[Orbit], convergence: Table
) -> dict[str, Callable[[], Figure]]:
    figures: dict[str, Callable[[], Figure]] = {
        "bifurcation": partial(_bifurcation, branch, hopf),
        "frequency": partial(_frequency, branch, hopf),
        "multipliers": partial(_multipliers, branch),
        "harmonics": partial(_harmonics, convergence),
    }
    if cycles:
        figures |= {"orbits_90": partial(_orbits, cycles), "spectrum_90": partial(_spectrum, cycles)}
    return figures


def _published(quantity: str) -> list[tuple[str, list[float], list[float], str]]:
    """Return the points of Table 1 for "omega", "a1" or "a2", by equivalent linearisation and integration."""
    points = []
    for label, kind, marker in (("equivalent linearisation, Yang", "el", "s"), ("integration, Yang", "ni", "o")):
        rows = [s for s in TABLE_1 if getattr(s, f"{quantity}_{kind}") is not None]
        points.append((label, [s.V for s in rows], [getattr(s, f"{quantity}_{kind}") for s in rows], marker))
    return points


def _bifurcation(branch: Branch, hopf: SpecialPoint) -> Figure:
    """Amplitude of both wheelsets over speed, over the whole range and about the fold."""
    from hbbogie import plot

    figure, axes = plot.panels(2, 2)
    for row, (coordinate, wheelset, title) in enumerate(
        (("q1", "a1", "front wheelset"), ("q3", "a2", "rear wheelset"))
    ):
        points = _published(wheelset)
        whole, close = axes[row]
        about: dict[str, Any] = {"y": coordinate, "parameter_label": SPEED}
        plot.branch(branch, ax=whole, published=points, special=[hopf], **about).set_title(title, fontsize=11)
        near = [(n, *_within(x, y), m) for n, x, y, m in points]
        plot.branch(branch, ax=close, published=near, **about).set_title(f"{title}, about the fold", fontsize=11)
        inside = branch.amplitude(coordinate)[(branch.values >= ABOUT[0]) & (branch.values <= ABOUT[1])]
        close.set_xlim(*ABOUT)
        if len(inside):
            close.set_ylim(1e3 * inside.min() - 0.4, 1e3 * inside.max() + 0.6)
    return plot.one_legend(figure)


def _within(x: list[float], y: list[float]) -> tuple[list[float], list[float]]:
    """Return the points whose speed lies about the fold."""
    keep = [(a, b) for a, b in zip(x, y, strict=True) if ABOUT[0] <= a <= ABOUT[1]]
    return [a for a, _ in keep], [b for _, b in keep]


def _frequency(branch: Branch, hopf: SpecialPoint) -> Figure:
    from hbbogie import plot

    ax = plot.frequency(branch, published=_published("omega"), parameter_label=SPEED, special=[hopf])
    return plot.figure_of(ax)


def _multipliers(branch: Branch) -> Figure:
    """Largest multipliers along the branch, over the whole range and about the fold."""
    from hbbogie import plot

    figure, axes = plot.panels(1, 2)
    plot.multipliers_along(branch, ax=axes[0, 0], parameter_label=SPEED)
    plot.multipliers_along(branch, ax=axes[0, 1], parameter_label=SPEED).set_title("about the fold", fontsize=11)
    axes[0, 1].set_xlim(*ABOUT)
    return plot.one_legend(figure)


def _orbits(cycles: list[Orbit]) -> Figure:
    """Phase portraits and waveforms of both wheelsets."""
    from hbbogie import plot

    figure, axes = plot.panels(2, 2)
    for row, (coordinate, title) in enumerate((("q1", "front wheelset"), ("q3", "rear wheelset"))):
        plot.orbit(cycles, x=coordinate, ax=axes[row, 0]).set_title(f"{title}, V = 90 m/s", fontsize=11)
        plot.waveform(cycles, [coordinate], ax=axes[row, 1]).set_title(f"{title}, one period", fontsize=11)
    return plot.one_legend(figure)


def _spectrum(cycles: list[Orbit]) -> Figure:
    from hbbogie import plot

    return plot.figure_of(plot.spectrum(cycles, "q1", reference=True))


def _harmonics(convergence: Table) -> Figure:
    """Errors of frequency and peaks over the highest harmonic."""
    from hbbogie import plot

    figure, ((ax,),) = plot.panels(1, 1)
    with plot.style():
        rows = [r for r in convergence.rows if r[0] != TRUTH and r[2] is not None]
        for k, (label, marker) in enumerate(
            (("frequency", "o"), ("front wheelset, peak", "s"), ("rear wheelset, peak", "^"))
        ):
            ax.loglog([r[0] for r in rows], [r[2 + k] for r in rows], marker + "-", label=label)
        ax.set_xlabel("highest harmonic H [1]")
        ax.set_ylabel(f"largest error against H = {TRUTH} [%]")
        ax.set_xticks([r[0] for r in rows], [str(r[0]) for r in rows])
        ax.minorticks_off()
        ax.legend()
    return figure
