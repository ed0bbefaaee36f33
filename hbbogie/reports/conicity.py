"""The equivalent conicity of a wheel on a rail, as a report."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hbbogie.errors import ModelError, positive, unknown_name
from hbbogie.railway.conicity import equivalent_conicity
from hbbogie.railway.contact import contact_geometry
from hbbogie.railway.profiles import Profile, read_rail, read_wheel, s1002, uic60
from hbbogie.railway.sampling import sampling_error
from hbbogie.reports.figures import Figures, draw
from hbbogie.reports.report import Report
from hbbogie.reports.table import Table
from hbbogie.results.conicity import Conicity
from hbbogie.results.contact_geometry import ContactGeometry

AMPLITUDES = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0)  # mm
FINE = 0.1  # mm between the amplitudes of the curve
COARSE = 0.03  # change of a conicity without every other point of a profile above which its points are too far apart
WHEELS = {"s1002": s1002}


def conicity_of(
    wheel: str,
    rail: str,
    *,
    amplitudes: Sequence[float] = AMPLITUDES,
    largest: float = 8.0,
    step: float = 0.1,
    gauge: float = 1435.0,
    back_to_back: float = 1360.0,
    radius: float = 460.0,
    mirrored: bool = False,
    inclination: float | None = None,
    left_wheel: str | None = None,
    left_rail: str | None = None,
    left_radius: float | None = None,
) -> Report:
    """Compute contact geometry and equivalent conicity.

    Parameters
    ----------
    wheel, rail : str
        "s1002" and "uic60", or paths of text files.
    amplitudes : sequence of float, mm
        Of the table that is shown.
    largest, step : float, mm
        Lateral shifts run from -largest to largest in such steps.
    gauge, back_to_back, radius : float, mm
        As of `contact_geometry`.
    mirrored : bool
        Whether the files of the rails have their gauge faces at y > 0.
    inclination : float, optional, 1
        Of the rails, as of `uic60` and `read_rail`.
    left_wheel, left_rail : str, optional
        As wheel and rail, where the left side differs.
    left_radius : float, optional, mm

    Raises
    ------
    ModelError
        For wrong input, and where the travel of an amplitude leaves the range of shifts.
    """
    positive("largest shift", largest, "mm")
    if positive("step", step, "mm") > largest:
        raise ModelError(f"step {step:g} mm is more than the largest shift, {largest:g} mm; give a smaller one.")
    leaning: dict[str, Any] = {} if inclination is None else {"inclination": inclination}
    rails, reading = {"uic60": partial(uic60, **leaning)}, partial(read_rail, mirrored=mirrored, **leaning)
    on_wheel, on_rail = _profile(wheel, WHEELS, read_wheel), _profile(rail, rails, reading)
    other_wheel = _profile(left_wheel, WHEELS, read_wheel) if left_wheel else None
    other_rail = _profile(left_rail, rails, reading) if left_rail else None
    half = int(np.floor(largest / step + 1e-9))
    shift = step * np.arange(-half, half + 1)
    geometry = {
        "gauge": gauge, "back_to_back": back_to_back, "radius": radius,
        "left_wheel": other_wheel, "left_rail": other_rail, "left_radius": left_radius,
    }  # fmt: skip
    found = contact_geometry(on_wheel, on_rail, shift, **geometry)  # type: ignore[arg-type]
    shown = equivalent_conicity(shift, found.radius_difference, list(amplitudes))
    changes = sampling_error(on_wheel, on_rail, shift, list(amplitudes), **geometry)  # type: ignore[arg-type]
    fine = np.arange(round(min(amplitudes) / FINE), round(max(amplitudes) / FINE) + 1) * FINE
    curve = equivalent_conicity(shift, found.radius_difference, fine[fine > 0] if len(fine) > 1 else list(amplitudes))
    title = f"{found.wheel} on {found.rail}"
    figures: Figures = {
        "conicity": partial(draw, "conicity", curve),
        "radius_difference": partial(draw, "contact", found),
        "contact_angle": partial(draw, "contact", found, y="contact angle"),
        "contact_point": partial(draw, "contact", found, y="contact point"),
    }
    lean = "" if inclination is None else f", rails inclined by {inclination:g}"
    other = f", the left one {left_radius:g} mm" if left_radius else ""
    notes = [
        f"Rigid contact at gauge {gauge:g} mm, flanges {back_to_back:g} mm back to back, wheels of radius {radius:g} "
        f"mm{other}{lean}; shifts every {step:g} mm up to {largest:g} mm."
    ]
    names = {"wheel": found.wheel, "rail": found.rail}
    notes += [_of_points(names[part], shown, change) for part, change in changes.items()]
    if np.isnan(curve.equivalent).any():
        notes.append("Where no number is given by EN 15302 the wheelset does not swing about its centre.")
    data = {"gauge_mm": gauge, "back_to_back_mm": back_to_back, "radius_mm": radius}
    table = conicity_table(shown, f"{title}: equivalent conicity", "conicity")
    long = conicity_table(curve, f"{title}: equivalent conicity over amplitude", "conicity_curve"), contact_table(found)
    return Report(title, (table,), {}, figures, tuple(notes), data, long)


def _of_points(name: str, curve: Conicity, change: NDArray[np.float64]) -> str:
    """Return by how much conicities change without every other point of a profile; a warning where it is much."""
    if not np.isfinite(curve.equivalent).any():
        return f"{name}: no conicity by which to judge the distance of its points."
    worst = int(np.nanargmax(change))
    at = f"amplitude {curve.amplitude[worst]:g} mm"
    if not np.isfinite(change[worst]):
        return (
            f"WARNING: the points of {name} are too far apart or too few: without every other of them there is no "
            f"conicity at {at}, so that nothing tells how far the given ones are off. Give points closer together."
        )
    said = f"without every other point of {name} the conicity changes by up to {change[worst]:.2g}, at {at}"
    if change[worst] <= COARSE:
        return f"{said[0].upper()}{said[1:]}."
    return (
        f"WARNING: the points of {name} are too far apart: {said}, where it is {curve.equivalent[worst]:.3f}. "
        "Its error may come near to that. Give points closer together."
    )


def conicity_table(curve: Conicity, title: str, name: str) -> Table:
    """Return conicities over the amplitude."""
    columns = (curve.amplitude, curve.equivalent, curve.least_squares, curve.harmonic, curve.centre)
    rows = [tuple(float(v) if np.isfinite(v) else None for v in row) for row in zip(*columns, strict=True)]
    heads = ("amplitude [mm]", "EN 15302", "least squares", "describing function", "centre [mm]")
    return Table(name, title, heads, tuple(rows), (".1f", ".4f", ".4f", ".4f", "z.3f"))


def contact_table(found: ContactGeometry) -> Table:
    """Return contact geometry over the lateral shift."""
    sides = ("right", "left")
    columns = {"shift [mm]": found.shift, "radius difference [mm]": found.radius_difference, "roll [rad]": found.roll}
    for field, unit in (("radius", "mm"), ("angle", "rad"), ("wheel", "mm"), ("rail", "mm")):
        what = {"wheel": "contact on wheel", "rail": "contact on rail"}.get(field, field)
        columns |= {f"{what}, {side} [{unit}]": getattr(found, f"{field}_{side}") for side in sides}
    rows = tuple(tuple(map(float, row)) for row in zip(*columns.values(), strict=True))
    title = f"{found.wheel} on {found.rail}: rigid contact"
    return Table("contact_geometry", title, tuple(columns), rows, (".4f",) * len(columns))


def _profile(given: str, shipped: Mapping[str, Callable[[], Profile]], read: Callable[[str], Profile]) -> Profile:
    """Return a profile by its name, or from a file."""
    if given.lower() in shipped:
        return shipped[given.lower()]()
    if not Path(given).suffix and not Path(given).exists():
        raise ModelError(f"{unknown_name('profile', given, shipped)} Or give the path of a text file.")
    return read(given)
