"""The job of simulating a motion: time history, figure, and the state to which the motion settles."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from hbbogie.errors import ModelError
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.model.system import System
from hbbogie.motion.integration import simulate
from hbbogie.motion.settling import Settled, settle
from hbbogie.progress import Progress, silent
from hbbogie.reports.figures import Figures, draw
from hbbogie.reports.report import Report
from hbbogie.reports.table import Table
from hbbogie.results import Trajectory
from hbbogie.results.failure import ConvergenceError
from hbbogie.units import label, per_second, readable

START = 4.0  # in units of the amplitude scale
if TYPE_CHECKING:
    from matplotlib.figure import Figure

PERIODS = 5  # at the end of a motion, shown once more
LONGEST = 200.0  # s that a motion is followed beyond its end to see where it settles


def default_start(system: System) -> dict[str, float]:
    """Return a start from which most cycles are reached: the first nonlinear coordinate far out, at rest."""
    name = (system.nonlinear_coordinates or system.coordinate_names)[0]
    return {name: START * float(HarmonicBalance(1).equations(system).scale[0])}


def simulated(
    system: System,
    initial: Mapping[str, float],
    duration: float,
    *,
    method: str = "rk4",
    step: float | None = None,
    progress: Progress = silent,
) -> Report:
    """Integrate a motion and say what it settles on.

    Parameters
    ----------
    system : System
    initial : mapping from name to value, unit of the coordinate (with a prime: per second)
    duration : float, s
    method, step
        As of `hbbogie.motion.simulate`.
    progress : callable
        Called with (message, fraction done or None).
    """
    progress("integrating", None)
    motion = simulate(system, initial, duration, method=method, step=step)
    began = ", ".join(f"{name} = {value:g}" for name, value in initial.items())
    notes = [f"{system.name}: {duration:g} s from {began} ({motion.method})."]
    progress("following the motion until it settles", None)
    settled: Settled | None = None
    try:
        settled = settle(system, motion, longest=LONGEST, method=method, step=step)
        notes.append(f"Followed on from t = {duration:g} s: {settled.status}")
    except ConvergenceError as error:
        notes.append(f"Followed on from t = {duration:g} s: {error}")
    tables = (settled_table(system, settled),) if settled else ()
    data = {"parameters": dict(system.values), "initial": dict(initial), "duration_s": duration}
    if settled:
        data["settled"] = {
            "kind": settled.kind,
            "omega_rad_s": settled.omega,
            "frequency_Hz": settled.omega / (2 * np.pi),
            "amplitude": settled.amplitudes,
            "status": settled.status,
        }
    figures: Figures = {"time_history": partial(_history, motion)}
    return Report(
        f"{system.name}: motion from {began}",
        tables,
        {},
        figures,
        tuple(notes),
        data,
        (history_table(motion),),
        summary=(_ending(system, settled, began),),
        about=(f"The motion during {duration:g} s, and on until it settles.",),
    )


def _ending(system: System, settled: Settled | None, began: str) -> str:
    """Return how a motion ends, a sentence."""
    kind = settled.kind if settled else "undecided"
    if settled is None or kind not in ("cycle", "rest"):
        return f"From {began} it is undecided where the motion settles."
    if kind == "rest":
        return f"From {began} the motion comes to rest."
    name = system.coordinate_names[0]
    unit = system.coordinates[0].unit
    factor, shown = readable(unit, settled.amplitudes[name])
    peak = f"{factor * settled.amplitudes[name]:.4g} {shown}".removesuffix(" 1")
    frequency = settled.omega / (2 * np.pi)
    return (
        f"From {began} the motion settles on a cycle of {frequency:.4g} Hz, with a peak of {peak} of "
        f"{system.naming.plain(name)}."
    )


def _history(motion: Trajectory) -> Figure:
    """Draw a motion over time; a long one as a whole, and its last periods below."""
    from hbbogie import plot

    try:
        length = PERIODS * motion.period()
    except ModelError:  # it does not oscillate
        length = float("inf")
    whole = motion.t[-1] - motion.t[0]
    if whole < 4 * length:
        return draw("time_history", motion)
    figure, ((top,), (bottom,)) = plot.panels(2, 1, (7.2, 5.6), plot.title_of(motion))
    plot.time_history(motion, ax=top).set_title("the whole motion", fontsize=10)
    late = motion.t >= motion.t[-1] - length
    end = replace(motion, t=motion.t[late], q=motion.q[late], v=motion.v[late])
    plot.time_history(end, ax=bottom).set_title(f"the last {PERIODS} periods", fontsize=10)
    return plot.one_legend(figure)


def settled_table(system: System, settled: Settled) -> Table:
    """Return the table of what a motion settled on: peak of every coordinate, and frequency."""
    title = {"cycle": "Settled on a cycle", "rest": "Settled at rest"}.get(settled.kind, "Not settled")
    if settled.kind == "cycle":
        title += f" of {settled.omega:.6g} rad/s ({settled.omega / (2 * np.pi):.6g} Hz)"
    units = {c.name: c.unit or "1" for c in system.coordinates}
    rows = tuple((name, peak, units[name]) for name, peak in settled.amplitudes.items())
    return Table("settled", title, ("coordinate", "peak", "unit"), rows, ("", ".6g", ""))


def history_table(motion: Trajectory) -> Table:
    """Return the time history: time, coordinates and velocities."""
    pairs = list(zip(motion.coordinates, motion.units, strict=True))
    rates = [label(f"{c}'", per_second(u)) for c, u in pairs]
    columns = ("t [s]", *(label(c, u) for c, u in pairs), *rates)
    rows = np.column_stack([motion.t, motion.q, motion.v]).tolist()
    return Table("time_history", "Time history", columns, tuple(map(tuple, rows)), (".7g",) * len(columns))
