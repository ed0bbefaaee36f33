"""What the page draws, as plain data: curves with their verdicts, special points, cycles, the moving system."""

from __future__ import annotations

from collections.abc import Sequence
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hbbogie.branches.judging import stability_of
from hbbogie.errors import ModelError
from hbbogie.exact.method import ExactEquations
from hbbogie.explorer.following import Explored
from hbbogie.plot.curves import DRESS, level_of, pieces
from hbbogie.reports.summary import diagram_sentences, rest_pieces
from hbbogie.reports.table import plain
from hbbogie.results import Orbit
from hbbogie.results.failure import FAILURES
from hbbogie.solving.solvers import solve
from hbbogie.units import behind, label, per_second, readable

Array = NDArray[np.float64]
SAMPLES = 240  # of a cycle that is drawn
PEAK = 512  # of an output whose peak is drawn over the parameter
FRAMES = 60  # of the moving system
DIGITS = 6  # of the numbers sent for drawing
SKIP = 3  # of the points of a curve of equilibria, one is drawn
NEAR = 0.02  # largest distance of a cycle from the place that was clicked, in units of the diagram


def diagram_data(found: Explored) -> dict[str, Any]:
    """Return a diagram in the units in which it is drawn.

    Returns
    -------
    dict
        ``axis`` and ``height`` with label, factor to the unit of the axis and range; ``curves`` of each branch, by
        verdict; ``points`` that were computed; ``rest``, the equilibria; ``marks``, the special points.
    """
    view, system = found.view, found.system
    x, y = _axis(found), _height(found)

    def height(o: Orbit) -> float:
        return _peak(found, o) * y["factor"]

    def shown(curves: Sequence[tuple[str, Array]]) -> list[dict[str, Any]]:
        return [{"verdict": v, "points": _short(np.asarray(c) * [x["factor"], 1.0])} for v, c in curves]

    branches, marks = [], []
    for name, b in found.curves.items():
        points = [[x["factor"] * v, height(o), o.verdict] for v, o in zip(b.values, b, strict=True)]
        own = {"name": name, "family": name in found.diagram.families}
        branches.append({**own, "curves": shown(pieces(b, height)), "points": points})
        marks += [_mark(s.kind, x, s.value, height(s.orbit), s.headline) for s in b.special if s.kind != "hopf"]
    for s in found.diagram.hopf:
        marks.append(_mark("hopf", x, s.value, level_of(s, height, height), s.headline))
    rest = [piece for b in found.equilibria for piece in shown([_thin(p) for p in rest_pieces(b, height)])]
    content: dict[str, Any] = {"axis": x, "height": y, "branches": branches, "marks": marks, "rest": rest}
    content["said"] = diagram_sentences(system, found.diagram, found.equilibria)
    content |= {"notes": _notes(found), "method": found_by(found), "view": view.as_dict(), "system": system.name}
    return plain(content)  # type: ignore[no-any-return]


def found_by(found: Explored) -> str:
    """Return how the cycles were computed."""
    exact = isinstance(found.equations, ExactEquations)
    return "cycles in closed form" if exact else found.equations.method  # type: ignore[union-attr]


def _notes(found: Explored) -> list[str]:
    notes = list(found.diagram.notes)
    if not found.complete:
        notes.insert(0, "Incomplete: the time for one diagram was over. What was found by then is shown.")
    if not found.curves:
        low, high = found.view.interval
        notes.append(f"No cycle was found between {found.view.parameter} = {low:g} and {high:g}.")
    return notes


def _axis(found: Explored) -> dict[str, Any]:
    name, (low, high) = found.view.parameter, found.view.interval
    parameter = found.system.parameter(name)
    factor, unit = readable(parameter.unit, max(abs(low), abs(high)))
    text = label(found.system.naming.plain(name), unit)
    return {"label": text, "factor": factor, "unit": unit, "low": low * factor, "high": high * factor}


def _height(found: Explored) -> dict[str, Any]:
    name = found.view.coordinate
    curves = found.diagram.branches or found.diagram.families
    top, rest = (
        max((_peak(found, o) for b in some for o in b), default=0.0) for some in (curves.values(), found.equilibria)
    )
    factor, unit = readable(found.system.naming.units[name], top or rest)
    text = label(f"peak of {found.system.naming.plain(name)}", unit)
    return {"label": text, "factor": factor, "unit": unit, "high": (top or rest) * factor}


def _peak(found: Explored, o: Orbit) -> float:
    """Return what is drawn of an orbit, which is computed once for a diagram."""
    if o not in found.peaks:
        found.peaks[o] = _peak_of(o, found.view.coordinate)
    return found.peaks[o]


def _peak_of(o: Orbit, name: str) -> float:
    """Return the peak of a coordinate, or that of an output as a drawing shows it: the largest of many samples."""
    if not o.naming.is_output(name) or o.naming.measure is None:
        return o.amplitude(name)
    t = np.linspace(0.0, o.period, PEAK, endpoint=False) if o.H else np.zeros(1)
    y = o.naming.measure(o.q(t), o.v(t), np.array(list(o.parameters.values())))
    return float(np.abs(y[:, o.naming.outputs.index(name)]).max())


def _mark(kind: str, x: dict[str, Any], value: float, level: float, text: str) -> dict[str, Any]:
    return {"kind": kind, "name": DRESS.get(kind, ("", kind))[1], "x": value * x["factor"], "y": level, "text": text}


def _thin(piece: tuple[str, Array]) -> tuple[str, Array]:
    """Return a curve of equilibria with fewer points; one that is straight by its ends."""
    verdict, points = piece
    if not np.ptp(points[:, 1]):
        return verdict, points[[0, -1]]
    return verdict, np.vstack([points[:-1:SKIP], points[-1:]])


def _short(points: Array) -> list[list[float]]:
    """Return numbers with as many digits as a drawing shows."""
    return [[float(f"{v:.{DIGITS}g}") for v in row] for row in points]


# --- one cycle ---------------------------------------------------------------------------------


def cycle_at(found: Explored, name: str, value: float, height: float) -> Orbit:
    """Return the cycle of a branch next to a place in the diagram.

    Parameters
    ----------
    found : Explored
    name : str
        Of the branch.
    value, height : float
        The place, in the units in which the diagram is drawn.

    Raises
    ------
    ModelError
        When there is no such branch.
    """
    if name not in found.curves:
        raise ModelError(f"There is no branch {name!r}; click on a curve of cycles.")
    branch, q, p = found.curves[name], found.view.coordinate, found.view.parameter
    value, height = value / _axis(found)["factor"], height / _height(found)["factor"]
    peaks = np.array([_peak(found, o) for o in branch])
    size = np.ptp(branch.values) or 1.0, np.ptp(peaks) or 1.0
    away = np.hypot((branch.values - value) / size[0], (peaks - height) / size[1])
    i = int(np.argmin(away))
    nearest = branch.orbits[i]
    if name in found.diagram.families or away[i] < 1e-9:
        return nearest
    at: dict[str, Any] = {p: value}
    try:  # at the place itself, where that is on the curve
        orbit = solve(found.equations, nearest, **at)
    except FAILURES:
        return nearest
    off = abs(_peak_of(orbit, q) - height) / size[1]
    return orbit if orbit.H and off < min(NEAR, float(away[i])) else nearest


def cycle_data(found: Explored, orbit: Orbit, module: ModuleType | None = None) -> dict[str, Any]:
    """Return a cycle as the page draws it: one period, phase portrait, multipliers, peaks, frames of the system.

    Parameters
    ----------
    found : Explored
    orbit : Orbit
    module : module, optional
        Of the problem; where it has ``sketch``, the frames are drawn by it.
    """
    judged = orbit.stability or stability_of(found.system.with_parameters(**orbit.parameters), orbit)
    orbit = orbit.replace(stability=judged)
    t = np.linspace(0.0, orbit.period, SAMPLES + 1)
    q, v, naming = orbit.q(t), orbit.v(t), orbit.naming
    waves = []
    for i, (name, unit) in enumerate(zip(orbit.coordinates, orbit.units, strict=True)):
        factor, shown = readable(unit, orbit.amplitude(name))
        rate, fast = readable(per_second(unit), float(np.abs(v[:, i]).max()))
        own = {"name": name, "text": naming.plain(name), "unit": shown, "rate_unit": fast}
        waves.append({**own, "q": _few(factor * q[:, i]), "v": _few(rate * v[:, i]), "peak": orbit.peaks()[name]})
    for name, signal in orbit.outputs.items():
        factor, shown = readable(signal.unit, signal.peak)
        peak = f"{factor * signal.peak:.4g}{behind(shown)}"
        own = {"name": name, "text": naming.plain(name), "unit": shown}
        waves.append({**own, "q": _few(factor * signal.at(t)), "peak": peak})
    value = orbit.parameters[found.view.parameter]
    about = [
        ("at", naming.value(found.view.parameter, value, 7)),
        ("period", f"{orbit.period:.6g} s"),
        ("frequency", f"{orbit.frequency:.5g} Hz"),
        ("largest multiplier", "" if orbit.largest_multiplier is None else f"{orbit.largest_multiplier:.5g}"),
        ("computed by", orbit.method),
    ]
    multipliers = [[m.real, m.imag] for m in judged.multipliers.tolist()] if judged else []
    reason = judged.reason if judged else "Its multipliers could not be computed."
    content = {"t": _few(t), "waves": waves, "verdict": orbit.verdict, "reason": reason, "about": about}
    place = {
        "x": value * _axis(found)["factor"],
        "y": _peak_of(orbit, found.view.coordinate) * _height(found)["factor"],
    }
    return plain({**content, "multipliers": multipliers, "frames": _frames(orbit, module), **place})  # type: ignore[no-any-return]


def _frames(orbit: Orbit, module: ModuleType | None) -> dict[str, Any] | None:
    """Return the shapes of the system over one period, and what the drawing shows; None without a sketch."""
    sketch = getattr(module, "sketch", None)
    if sketch is None:
        return None
    frames = []
    for row in orbit.q(np.linspace(0.0, orbit.period, FRAMES, endpoint=False)):
        shapes = sketch(dict(zip(orbit.coordinates, map(float, row), strict=True)), dict(orbit.parameters))
        frames.append([{"kind": s.kind, "lit": s.lit, "x": _few(s.x), "y": _few(s.y)} for s in shapes])
    return {"shapes": frames, "text": (sketch.__doc__ or "").strip().partition("\n")[0]}


def _few(values: Any) -> list[float]:
    return [float(f"{v:.{DIGITS - 1}g}") for v in np.ravel(values)]
