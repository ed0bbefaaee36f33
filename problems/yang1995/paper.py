"""Yang (1995) in full: every method on every state, and figures 2 to 6 of the paper."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from hbbogie import ConvergenceError, Orbit, System, simulate, solve, verify
from hbbogie.branches import TracedBranch, compare, method_named
from hbbogie.methods import Compatible, HeuristicStability, compatible, describing_function, heuristic_stability
from hbbogie.model import DeadBand
from hbbogie.motion import settle
from hbbogie.progress import Progress
from hbbogie.reports import Report, Table, table_of_methods, verdicts
from hbbogie.results import Trajectory

from .bogie import RANGE, TABLE_1
from .table_1 import PUSHED, SPEED

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FRONT, REAR = "front flange", "rear flange"
HELD_AT_A1 = ("paper, search", "paper, NLP", "df1", "df2")


# --- describing function or multi-harmonic balance, state by state ----------------------------


@dataclass(frozen=True, eq=False)
class Answer:
    """What one method says of one state.

    Attributes
    ----------
    V : float, m/s
    omega : float, rad/s
    a1, a2 : float, m
        First-harmonic amplitudes of both wheelsets by describing functions and the paper's method, peaks by
        the others.
    peaks : bool
        Whether a1 and a2 are peaks.
    milliseconds : float or None
        Time of the solve.
    evaluations : int or None
    """

    V: float
    omega: float
    a1: float
    a2: float
    peaks: bool
    milliseconds: float | None = None
    evaluations: int | None = None

    def errors(self, truth: Orbit) -> tuple[float, float, float]:
        """Return the errors of frequency and both amplitudes against a converged cycle [%]."""
        size = truth.amplitude if self.peaks else truth.first_harmonic
        pairs = (self.omega, truth.omega), (self.a1, size("q1")), (self.a2, size("q3"))
        return tuple(100 * (x / y - 1) for x, y in pairs)  # type: ignore[return-value]


@dataclass(frozen=True, eq=False)
class StateByAll:
    """One state of Table 1 by every method, the converged cycles to compare with, and both verdicts."""

    printed: Any
    answers: dict[str, Answer]
    truths: dict[str, Orbit]
    heuristic: HeuristicStability | None
    floquet: str | None
    remark: str


def comparison(system: System, methods: Sequence[str], progress: Progress) -> Report:
    """Compare describing functions, the paper's method, multi-harmonic balance and integration."""
    stable = [s.V for s in TABLE_1 if s.a1_ni is not None]
    names = list(dict.fromkeys([*methods, "df1", "df2", "mhb15"]))
    found = compare(
        system, names, stable, parameter="V", interval=RANGE, progress=lambda m, f: progress(m, (f or 0) / 2)
    )
    states = []
    for i, state in enumerate(TABLE_1[1:]):
        progress(f"state {state.state} of Table 1", 0.5 + 0.5 * i / len(TABLE_1))
        states.append(_state(system, state, found.methods))
    tables = (
        _table(states, "speeds", "Speed at the printed amplitude a1", "V", "[m/s]", lambda a: a.V, ".3f", 1.0),
        _table(states, "frequencies", "Frequency", "omega", "[rad/s]", lambda a: a.omega, ".3f", 1.0),
        _table(states, "amplitudes", "Amplitude of the rear wheelset", "a2", "[mm]", lambda a: a.a2, ".3f", 1e3),
        _errors(states),
        _effort(states),
        _stability(states),
        table_of_methods(found),
    )
    notes = (_sentence(states), *verdicts(found), *_misprint(states))
    figures: dict[str, Callable[[], Figure]] = {"comparison": partial(_comparison_page, found.methods, states)}
    branches = {f"branch_{name}": method.branch for name, method in found.methods.items()}
    return Report("Describing function or multi-harmonic balance? Yang's bogie", tables, branches, figures, notes)


def _state(system: System, state: Any, followed: dict[str, TracedBranch]) -> StateByAll:
    """Compute one state: at its printed a1 by one harmonic, at its printed speed by the others."""
    part = 0 if state.a1_ni is None else 1  # states 2 and 3 lie before the fold
    answers = {"printed EL": Answer(state.V, state.omega_el, state.a1_el, state.a2_el, False)}
    cycle = None
    for name, method in (("paper, search", "search"), ("paper, NLP", "ipopt")):
        try:
            cycle = compatible(system, {FRONT: state.a1_el}, "V", RANGE, method=method)
        except ConvergenceError:
            continue
        answers[name] = _of_paper(cycle)
    for name in ("df1", "df2"):
        if (answer := _at_amplitude(system, followed[name], state.a1_el)) is not None:
            answers[name] = answer
    fine = followed["mhb15"].at(state.V).get(part)
    remark = ""
    if fine is not None:
        orbit, seconds = fine
        answers["mhb15"] = _of_orbit(orbit, 1e3 * seconds)
    else:
        remark = "no cycle at the printed speed: multi-harmonic balance at the printed a1"
        if (answer := _at_amplitude(system, followed["mhb15"], state.a1_el, peaks=True)) is not None:
            answers["mhb15"] = answer
    if state.a1_ni is not None:
        answers["printed NI"] = Answer(state.V, state.omega_ni, state.a1_ni, state.a2_ni, True)
        start = time.perf_counter()
        settled = settle(system, PUSHED, V=state.V)
        if settled.kind == "cycle":
            a = settled.amplitudes
            elapsed = 1e3 * (time.perf_counter() - start)
            answers["RK4"] = Answer(state.V, settled.omega, a["q1"], a["q3"], True, elapsed)
    polished: dict[tuple[float, float], Orbit] = {}
    truths: dict[str, Orbit] = {}
    for name, answer in answers.items():
        if (near := _truth(system, followed["mhb61"], answer)) is not None:
            key = round(near.parameters["V"], 7), round(near.omega, 7)
            if key not in polished:
                polished[key] = verify(system, near).orbit
            truths[name] = polished[key]
    judged = None if cycle is None else heuristic_stability(system, cycle)
    own = truths.get("mhb15")
    verdict = own.stability.verdict if own is not None and own.stability is not None else None
    return StateByAll(state, answers, truths, judged, verdict, remark)


def _of_paper(cycle: Compatible) -> Answer:
    a = cycle.amplitudes
    return Answer(cycle.value, cycle.omega, a[FRONT], a[REAR], False, cycle.milliseconds, cycle.evaluations)


def _of_orbit(orbit: Orbit, milliseconds: float, peaks: bool = True) -> Answer:
    size = orbit.amplitude if peaks else orbit.first_harmonic
    return Answer(orbit.parameters["V"], orbit.omega, size("q1"), size("q3"), peaks, milliseconds)


def _at_amplitude(system: System, followed: TracedBranch, a1: float, peaks: bool = False) -> Answer | None:
    """Return the cycle of a method with the first-harmonic amplitude a1 of the front wheelset."""
    near = min(followed.branch.orbits, key=lambda o: abs(o.first_harmonic("q1") - a1))
    equations = method_named(followed.name).equations(system)
    start = time.perf_counter()
    try:
        orbit = solve(equations, near, amplitude={"q1": a1}, free="V")
    except ConvergenceError:
        return None
    return _of_orbit(orbit, 1e3 * (time.perf_counter() - start), peaks)


def _truth(system: System, converged: TracedBranch, answer: Answer) -> Orbit | None:
    """Return the converged cycle at the answer's speed, the one nearest in a1; at its a1 where there is none."""
    found = [orbit for orbit, _ in converged.at(answer.V).values()]
    if found:
        return min(found, key=lambda o: abs((o.amplitude if answer.peaks else o.first_harmonic)("q1") - answer.a1))
    near = min(converged.branch.orbits, key=lambda o: abs(o.first_harmonic("q1") - answer.a1))
    try:
        return solve(method_named(converged.name).equations(system), near, amplitude={"q1": answer.a1}, free="V")
    except ConvergenceError:
        return None


ALL = ("printed EL", "paper, search", "paper, NLP", "df1", "df2", "mhb15", "printed NI", "RK4")


def _table(
    states: list[StateByAll],
    name: str,
    title: str,
    symbol: str,
    unit: str,
    take: Callable[[Answer], float],
    form: str,
    factor: float,
) -> Table:
    columns = ("state", *(f"{symbol} {method} {unit}" for method in ALL))
    rows = []
    for s in states:
        values = [factor * take(s.answers[m]) if m in s.answers else None for m in ALL]
        rows.append((s.printed.state, *values))
    notes = [f"State {s.printed.state}: {s.remark}." for s in states if s.remark]
    notes.append(
        "Describing functions and the paper's method are solved at the printed a1, the others at the printed speed. "
        "df and EL amplitudes are first harmonics, those of mhb15, NI and RK4 peaks."
    )
    return Table(name, title, columns, tuple(rows), ("d", *[form] * len(ALL)), tuple(notes))


def _errors(states: list[StateByAll]) -> Table:
    """Return the errors of every method against converged cycles at its own speed."""
    shown = [m for m in ALL if m != "paper, search"]
    columns = ("state", *(f"{q} {m} [%]" for m in shown for q in ("omega", "a1", "a2")))
    rows = []
    for s in states:
        entries: list[float | None] = []
        for m in shown:
            known = m in s.answers and m in s.truths
            entries += s.answers[m].errors(s.truths[m]) if known else (None, None, None)
        rows.append((s.printed.state, *entries))
    note = (
        "Truth: the cycle at the speed of each answer (where no cycle exists there, at its a1), polished by multiple "
        "shooting with located contact times; integration agrees, as the RK4 columns show. First harmonics are "
        "compared with first harmonics, peaks with peaks."
    )
    return Table(
        "errors", "Errors against converged cycles", columns, tuple(rows), ("d", *[".3f"] * (len(columns) - 1)), (note,)
    )


def _effort(states: list[StateByAll]) -> Table:
    columns = ["state", "evaluations paper, search", "evaluations paper, NLP"]
    timed = ("paper, search", "paper, NLP", "df1", "df2", "mhb15", "RK4")
    columns += [f"{m} [ms]" for m in timed]
    rows = []
    for s in states:
        counts = [s.answers[m].evaluations if m in s.answers else None for m in timed[:2]]
        times = [s.answers[m].milliseconds if m in s.answers else None for m in timed]
        rows.append((s.printed.state, *counts, *times))
    return Table("effort", "What each solve takes", tuple(columns), tuple(rows), ("d", "d", "d", *[".2f"] * len(timed)))


def _stability(states: list[StateByAll]) -> Table:
    columns = (
        "state",
        "front: dV/da1 [m/s/mm]",
        "front",
        "rear: dV/da2 [m/s/mm]",
        "rear",
        "heuristic",
        "Floquet",
    )
    rows = []
    for s in states:
        entries: list[Any] = [None] * 5
        if s.heuristic is not None:
            by_name = {c.element: c for c in s.heuristic.components}
            entries = [x for n in (FRONT, REAR) for x in (1e-3 * by_name[n].slope, by_name[n].verdict)]
            entries.append(s.heuristic.verdict)
        rows.append((s.printed.state, *entries, s.floquet))
    note = "Heuristic: section 4.1 of the paper, the other wheelset staying compatible; Floquet: the true cycle."
    return Table("stability", "Heuristic stability", columns, tuple(rows), ("d", ".3f", "", ".3f", "", "", ""), (note,))


def _sentence(states: list[StateByAll]) -> str:
    """Say from the numbers where the describing function is good enough and where not."""
    worst = {}
    for s in states:
        if "df1" in s.answers and "df1" in s.truths:
            worst[s.answers["df1"].V] = max(abs(e) for e in s.answers["df1"].errors(s.truths["df1"]))
    good = [V for V, e in worst.items() if e <= 2.0]
    place = max(worst, key=lambda V: worst[V])
    where = (
        f"at {len(good)} of {len(worst)} states ({min(good):.1f} to {max(good):.1f} m/s)"
        if good
        else "at none of the states"
    )
    return (
        f"The first-order describing function is within 2 % in frequency and first harmonics {where}; it is "
        f"{worst[place]:.0f} % off at {place:.0f} m/s."
    )


def _misprint(states: list[StateByAll]) -> tuple[str, ...]:
    """Return the evidence that the printed speed of state 6 does not fit its row."""
    s = next(s for s in states if s.printed.state == 6)
    ours = s.answers.get("paper, NLP")
    if ours is None or abs(ours.V - s.printed.V) < 1.0:
        return ()
    return (
        f"State 6: at the printed a1 the paper's method gives V = {ours.V:.2f} m/s with omega {ours.omega:.2f} and "
        f"a2 {1e3 * ours.a2:.1f} mm, as printed ({s.printed.omega_el:.2f}, {1e3 * s.printed.a2_el:.1f}); the printed "
        f"speed {s.printed.V:.2f} looks like a misprint of 94.22. Its printed integration fits at {s.printed.V:.2f}.",
    )


def _dress(method: str) -> dict[str, Any]:
    """Return colour and width of a method's lines, the wide ones below the narrow ones that lie on them."""
    from hbbogie.plot import NEUTRAL

    known = {"df1": (3, 4.0), "df2": (2, 1.2), "mhb3": (4, 1.2), "mhb15": (1, 1.2), "RK4": (0, 1.2), "exact": (2, 1.2)}
    if method == "mhb61":
        return {"color": "#d0d0d0", "lw": 5.0, "zorder": 2}
    colour, width = known.get(method, (0, 1.2))
    return {"color": NEUTRAL[colour], "lw": width, "zorder": 3 if width > 2 else 4}


def _comparison_page(followed: dict[str, TracedBranch], states: list[StateByAll]) -> Figure:
    """Branches by every method, and their errors over speed."""
    from hbbogie import plot

    figure, axes = plot.panels(2, 2)
    for ax, coordinate, a in ((axes[0, 0], "q1", "a1"), (axes[0, 1], "q3", "a2")):
        for method in followed.values():
            V, size = method.branch.values, 1e3 * method.branch.amplitude(coordinate)
            ax.plot(V, size, label=method.name, **_dress(method.name))
        for label, m, marker in (("printed EL", "printed EL", "s"), ("printed NI", "printed NI", "o")):
            some = [s.answers[m] for s in states if m in s.answers]
            ax.plot(
                [x.V for x in some],
                [1e3 * getattr(x, a) for x in some],
                marker,
                mfc="white",
                ms=5,
                label=label,
                zorder=6,
            )
        ax.set_xlabel(SPEED)
        ax.set_ylabel(f"peak of {coordinate} [mm]")
    for ax, k, what in ((axes[1, 0], 0, "frequency"), (axes[1, 1], 1, "amplitude of the front wheelset")):
        for m in ("df1", "df2", "mhb15", "RK4"):
            pairs = [(s.answers[m].V, abs(s.answers[m].errors(s.truths[m])[k])) for s in states if m in s.truths]
            pairs = [(V, e) for V, e in pairs if e > 1e-9]  # an amplitude that is held has no error
            if pairs:
                look = {"color": _dress(m)["color"], "mfc": "none", "ms": 7 if m == "df1" else 4}
                ax.semilogy(*zip(*pairs, strict=True), "o", label=f"error, {m}", **look)
        ax.set_xlabel(SPEED)
        ax.set_ylabel(f"error of {what} [%]")
    return plot.one_legend(figure)


# --- the figures of the paper -----------------------------------------------------------------


def paper(system: System, progress: Progress) -> Report:
    """Draw figures 2 to 6 of the paper from our results."""
    progress("figure 2", 0.0)
    data: dict[str, Any] = {}
    cycles = {}
    for i, number in enumerate((2, 4)):
        state = TABLE_1[number - 1]
        progress(f"figures 3 and 4: state {number}", 0.2 + 0.2 * i)
        cycle = compatible(system, {FRONT: state.a1_el}, "V", RANGE)
        cycles[number] = {
            kind: heuristic_stability(system, cycle, others=kind, points=31) for kind in ("follow", "held")
        }
    progress("figures 5 and 6", 0.7)
    motions = {
        5: simulate(system, {"q1": 0.0093, "q3": 0.0093}, 20.0, V=90.0),
        6: simulate(system, {"q1": 0.03, "q3": 0.03}, 20.0, V=90.0),
    }
    ends = {n: settle(system, m, V=90.0) for n, m in motions.items()}
    figures: dict[str, Callable[[], Figure]] = {
        "figure_2": partial(_figure_2, system),
        "figure_3": partial(_scheme, cycles, REAR, "Fig. 3: rear wheelset"),
        "figure_4": partial(_scheme, cycles, FRONT, "Fig. 4: front wheelset"),
        "figure_5": partial(_history, motions[5], 5),
        "figure_6": partial(_history, motions[6], 6),
    }
    for number, by_kind in cycles.items():
        for kind, judged in by_kind.items():
            data[f"state_{number}_{kind}"] = {
                c.element: {
                    "amplitude_m": c.amplitudes,
                    "stiffness_N_m": c.stiffness,
                    "critical_m_s": c.critical,
                    "verdict": c.verdict,
                }
                for c in judged.components
            }
    state = TABLE_1[3]
    printed = f"{1e3 * state.a1_ni:.1f} and {1e3 * state.a2_ni:.1f} mm"
    peaks = [1e3 * ends[6].amplitudes[q] for q in ("q1", "q3")]
    notes = (
        f"Figure 5: from q1 = q3 = 9.3 mm at 90 m/s the motion ends at rest ({ends[5].kind}).",
        f"Figure 6: from 30 mm it settles on state 4: {peaks[0]:.2f} and {peaks[1]:.2f} mm, printed {printed}.",
        "The paper does not print its step size; ours is 1 ms.",
    )
    return Report("Figures 2 to 6 of Yang (1995)", (), {}, figures, notes, data)


def _figure_2(system: System) -> Figure:
    """Equivalent stiffness of the flange over amplitude."""
    from hbbogie import plot

    K0, y0 = system.values["K0"], system.values["y0"]
    Y = np.linspace(0, 6 * y0, 400)[1:]
    figure, ((ax,),) = plot.panels(1, 1)
    law = DeadBand(K0, y0)
    ax.plot(1e3 * Y, 1e-6 * np.asarray(describing_function(law, Y)), label="first order")
    ax.plot(1e3 * Y, 1e-6 * np.asarray(describing_function(law, Y, order=2)), "--", label="second order")
    ax.axhline(1e-6 * K0, color="#888888", lw=1.0, label="flange stiffness K0")
    ax.axvline(1e3 * y0, color="#888888", lw=1.0, ls=":", label="flange clearance y0")
    ax.set_xlabel("amplitude Y [mm]")
    ax.set_ylabel("equivalent stiffness [MN/m]")
    ax.set_title("Fig. 2 (no published data)", fontsize=11)
    return plot.one_legend(figure)


def _scheme(cycles: dict[int, dict[str, HeuristicStability]], element: str, title: str) -> Figure:
    """Draw the scheme of section 4.1: critical speed over the amplitude of one wheelset."""
    from hbbogie import plot

    figure, axes = plot.panels(1, 2)
    for ax, (number, by_kind) in zip(axes[0], cycles.items(), strict=True):
        for kind, dash in (("follow", "-"), ("held", "--")):
            judged = by_kind[kind]
            c = next(c for c in judged.components if c.element == element)
            other = "other wheelset compatible" if kind == "follow" else "other wheelset held"
            ax.plot(1e3 * c.amplitudes, c.critical, dash, label=f"critical speed, {other}")
        ax.axhline(judged.value, color="#888888", lw=1.0, label="speed run at")
        ax.plot(1e3 * c.amplitude, judged.value, "ko", ms=6, label="the cycle")
        verdict = next(x for x in by_kind["follow"].components if x.element == element).verdict
        ax.set_xlabel("amplitude [mm]")
        ax.set_ylabel("critical speed [m/s]")
        ax.set_title(f"{title}, state {number}: {verdict} (no published data)", fontsize=10)
    return plot.one_legend(figure)


def _history(motion: Trajectory, number: int) -> Figure:
    from hbbogie import plot

    figure, axes = plot.panels(2, 1, (8.0, 6.0))
    state = TABLE_1[3]
    for ax, q, printed in ((axes[0, 0], "q1", state.a1_ni), (axes[1, 0], "q3", state.a2_ni)):
        plot.time_history(motion, [q], ax=ax)
        if number == 6:
            for sign in (1, -1):
                label = "printed amplitude of state 4" if sign > 0 else "_"
                ax.axhline(sign * 1e3 * printed, color="#AA4499", ls="--", lw=1.2, label=label, zorder=6)
    what = "printed amplitudes drawn over it" if number == 6 else "no published data"
    axes[0, 0].set_title(f"Fig. {number}: V = 90 m/s, q1 = q3 = {1e3 * motion.q[0, 0]:.1f} mm ({what})", fontsize=11)
    return plot.one_legend(figure) if number == 6 else figure
