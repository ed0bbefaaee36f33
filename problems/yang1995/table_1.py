"""The main job: Table 1 of Yang (1995) beside multi-harmonic balance and integration, as tables and figures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from hbbogie import (
    Branch,
    ConvergenceError,
    HarmonicBalance,
    ModelError,
    Orbit,
    System,
    floquet,
    hopf_points,
    solve,
    trace,
)
from hbbogie.branches import ORDERS, crossings, estimate, exact_crossings, exact_walk
from hbbogie.motion import settle
from hbbogie.progress import Progress
from hbbogie.reports import Report, Table, outputs_table
from hbbogie.results import SpecialPoint

from .bogie import PARAMETER, RANGE, TABLE_1, State

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hbbogie.exact import Walk
    from hbbogie.methods import Equations

TOLERANCE = 1e-3  # error of frequency and waveform by shooting that decides how many harmonics are taken
TRUTH = 61  # highest harmonic that the others are compared with
PUSHED = {"q1": 0.03, "q3": 0.03}  # m; both wheelsets against the flange, as in Fig. 6 of the paper
EL, NI, MHB, EXACT, RK4 = "printed EL", "printed NI", "MHB", "exact", "RK4"


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
    exact : Orbit or None
        The cycle in closed form at the speed of the orbit, where there is one.
    """

    printed: State
    orbit: Orbit | None
    integrated: tuple[float, float, float] | None
    remark: str
    exact: Orbit | None = None


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
    walk, closed = _in_closed_form(system, hopf[0])
    rows = []
    for i, state in enumerate(TABLE_1):
        progress(f"state {state.state} of Table 1", 0.3 + 0.4 * i / len(TABLE_1))
        row = compare(system, balance, branch, hopf[0], state)
        rows.append(row if walk is None else replace(row, exact=_exact_beside(walk, row)))
    progress(f"highest harmonics 1 to {TRUTH}", 0.7)
    convergence = harmonic_convergence(system, rows, hopf[0], H)
    tables = (table_of_states(rows, H), table_of_deviations(rows), convergence)
    both = [o.replace(stability=floquet(system, o)) for o in crossings(balance, branch, 90.0)]
    tables += (outputs_table(both, "Outputs of the cycles at 90 m/s"),) if both else ()
    folds = [f"{f.value:.4f} m/s" for f in branch.folds()]
    notes = (
        f"Linear critical speed {hopf[0].value:.3f} m/s, omega {hopf[0].omega:.4f} rad/s "
        f"({hopf[0].omega / (2 * np.pi):.4f} Hz); printed: 91.00 m/s, 26.96 rad/s.",
        f"Nonlinear critical speed (fold) with harmonics up to {H}: {', '.join(folds) or 'none in the range'}. "
        "Below it there is no hunting cycle.",
        closed,
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


def _in_closed_form(system: System, hopf: SpecialPoint) -> tuple[Walk | None, str]:
    """Return the branch of exact cycles, None where there is none, and a sentence."""
    try:
        walk = exact_walk(system, hopf, RANGE)
    except (ModelError, ConvergenceError) as error:
        return None, f"No cycles in closed form: {error}"
    folds = ", ".join(f"{f.value:.8f} m/s" for f in walk.marked("fold")) or "none in the range"
    return walk, f"The fold in closed form, without harmonics that are left out: {folds}."


def _exact_beside(walk: Walk, row: StateComparison) -> Orbit | None:
    """Return the exact cycle beside one of harmonic balance: at its speed, the nearest in frequency."""
    if row.orbit is None or row.printed.state == 1:
        return None
    found = [orbit for _, orbit in exact_crossings(walk, row.orbit.parameters[PARAMETER])]
    return min(found, key=lambda o: abs(o.omega - row.orbit.omega), default=None)


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


def _peaks(orbit: Orbit | None) -> tuple[float | None, float | None, float | None]:
    return (None,) * 3 if orbit is None else (orbit.omega, orbit.amplitude("q1"), orbit.amplitude("q3"))


def _computed(row: StateComparison) -> tuple[float | None, float | None, float | None]:
    """Return frequency and peaks by multi-harmonic balance; at the Hopf point the amplitude is anything up to y0."""
    return (row.orbit.omega, None, None) if row.printed.state == 1 and row.orbit else _peaks(row.orbit)


def table_of_states(rows: list[StateComparison], H: int) -> Table:
    """Return Table 1 of the paper with our columns beside the printed ones."""
    columns = ["state", "V [m/s]"]
    columns += [f"omega {m} [rad/s]" for m in (EL, NI, MHB, EXACT, RK4)]
    columns += [f"{a} {m} [mm]" for a in ("a1", "a2") for m in (EL, NI, MHB, EXACT, RK4)]
    body = []
    for row in rows:
        s, ours, exact, rk4 = row.printed, _computed(row), _peaks(row.exact), row.integrated or (None, None, None)
        amplitudes = [s.a1_el, s.a1_ni, ours[1], exact[1], rk4[1], s.a2_el, s.a2_ni, ours[2], exact[2], rk4[2]]
        millimetres = [None if a is None else 1e3 * a for a in amplitudes]
        stability = row.orbit.stability.verdict if row.orbit and row.orbit.stability else None
        body.append((s.state, s.V, s.omega_el, s.omega_ni, ours[0], exact[0], rk4[0], *millimetres, stability))
    formats = ("d", ".2f", ".2f", ".2f", *[".3f"] * 3, *[".1f", ".1f", *[".3f"] * 3] * 2, "")
    notes = (
        "EL: equivalent linearisation; NI: numerical integration (its printed frequencies are read off a 5 ms grid). "
        f"MHB: multi-harmonic balance, odd harmonics up to {H}; exact: cycles in closed form, at the speed of MHB's; "
        "RK4: our integration, step 1 ms. "
        "a1, a2: peak of the lateral displacement of the front and rear wheelset.",
        *(f"State {r.printed.state}: {r.remark}." for r in rows if r.remark),
    )
    return Table(
        "table1", "Table 1 of Yang (1995), printed and computed", (*columns, "stability"), tuple(body), formats, notes
    )


def table_of_deviations(rows: list[StateComparison]) -> Table:
    """Return the relative deviations of multi-harmonic balance from the other columns."""
    quantities = ("omega", "a1", "a2")
    columns = ("state", *(f"{q} MHB - {m} [%]" for m in (NI, RK4, EXACT, EL) for q in quantities))
    body = []
    for row in rows:
        s, ours = row.printed, _computed(row)
        integrated, exact = row.integrated or (None,) * 3, _peaks(row.exact)
        entries: list[float | None] = []
        for column in ((s.omega_ni, s.a1_ni, s.a2_ni), integrated, exact, (s.omega_el, s.a1_el, s.a2_el)):
            pairs = zip(ours, column, strict=True)
            entries += [None if a is None or b is None else 100 * (a / b - 1) for a, b in pairs]
        body.append((s.state, *entries))
    formats = ("d", *[".2f"] * 3, *[".4f"] * 6, *[".2f"] * 3)
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
        ax.set_xlabel("highest harmonic H")
        ax.set_ylabel(f"largest error against H = {TRUTH} [%]")
        ax.set_xticks([r[0] for r in rows], [str(r[0]) for r in rows])
        ax.minorticks_off()
        ax.legend()
    return figure
