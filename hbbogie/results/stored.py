"""What a labelled dataset holds of orbits: motions in any form, side by side, verdicts and names."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hbbogie import fourier
from hbbogie.results.linear_phases import LinearPhases
from hbbogie.results.naming import NAMELESS, Naming
from hbbogie.results.netcdf import _pack_complex, _unpack_complex
from hbbogie.results.periodic import FourierSeries, PeriodicMotion
from hbbogie.results.piecewise import PiecewisePolynomial
from hbbogie.results.signal import pack_signals, unpack_signals
from hbbogie.results.stability import Stability

if TYPE_CHECKING:
    import xarray as xr

    from hbbogie.results.orbit import Orbit

OTHERS = {kind.form: kind for kind in (LinearPhases, PiecewisePolynomial)}


def pack(orbits: Sequence[Orbit], dimension: str, prefix: str = "") -> dict[str, Any]:
    """Return the variables of orbits of one system."""
    units = set(orbits[0].units)
    own = {"units": (units.pop() or "1") if len(units) == 1 else "those of coordinate_unit"}
    data: dict[str, Any] = pack_motions([o.motion for o in orbits], dimension, prefix, own) | {
        "omega": (dimension, [o.omega for o in orbits], {"units": "rad/s", "long_name": "frequency"}),
        "parameters": (
            (dimension, "parameter"),
            [list(o.parameters.values()) for o in orbits],
            {"units": "those of parameter_unit"},
        ),
        "amplitude": (
            (dimension, "coordinate"),
            [[o.amplitude(c) for c in o.coordinates] for o in orbits],
            own | {"long_name": "largest absolute value over the period"},
        ),
        "residual": (dimension, [o.residual for o in orbits], {"units": "1", "long_name": "largest scaled residual"}),
        "errors": (dimension, np.array([json.dumps(o.errors) for o in orbits], dtype=str)),
        "method": (dimension, np.array([o.method for o in orbits], dtype=str)),
        "status": (dimension, np.array([o.status for o in orbits], dtype=str)),
    }
    if any(o.advance for o in orbits):
        grown = [o.advance or (0.0,) * len(o.coordinates) for o in orbits]
        data["advance"] = ((dimension, "coordinate"), grown, own | {"long_name": "growth in a period"})
    data |= pack_verdicts([o.stability for o in orbits], dimension, prefix)
    data |= pack_signals([o.outputs for o in orbits], dimension, prefix + "output_row")
    return {prefix + name: value for name, value in data.items()}


def fields_of(data: xr.Dataset, prefix: str = "") -> list[dict[str, Any]]:
    """Return the fields of the found that `pack` put into a dataset."""
    get = {name: data[prefix + name].values for name in ("omega", "parameters")}
    motions = unpack_motions(data, prefix)
    advance = data[prefix + "advance"].values if prefix + "advance" in data else np.zeros((len(get["omega"]), 1))
    coordinates = tuple(str(c) for c in data["coordinate"].values)
    names = [str(p) for p in data["parameter"].values]
    units, naming = names_of(data)
    found = []
    for i in range(len(get["omega"])):
        found.append(
            dict(
                system=str(data.attrs["system"]),
                coordinates=coordinates,
                units=units,
                motion=motions[i],
                omega=float(get["omega"][i]),
                parameters=dict(zip(names, map(float, get["parameters"][i]), strict=True)),
                method=str(data[prefix + "method"].values[i]),
                residual=float(data[prefix + "residual"].values[i]),
                status=str(data[prefix + "status"].values[i]),
                stability=unpack_verdict(data, prefix, i),
                errors=json.loads(str(data[prefix + "errors"].values[i])) if prefix + "errors" in data else None,
                naming=naming,
                advance=tuple(map(float, advance[i])) if advance[i].any() else (),
                recorded=unpack_signals(data, prefix, i, float(get["omega"][i])),
            )
        )
    return found


def pack_motions(
    motions: Sequence[PeriodicMotion], dimension: str, prefix: str, units: dict[str, str]
) -> dict[str, Any]:
    """Return the variables of motions: series padded with zeros to one highest harmonic, others with NaN.

    Parameters
    ----------
    motions : sequence of PeriodicMotion
    dimension, prefix : str
        Of the orbits, and of the other dimensions.
    units : dict
        Attribute of the coefficients that holds their unit.
    """
    series = [m.c if isinstance(m, FourierSeries) else None for m in motions]
    data: dict[str, Any] = {}
    if some := [c for c in series if c is not None]:
        H, n = max(map(fourier.highest, some)), some[0].shape[1]
        stack = np.array([np.full((2 * H + 1, n), np.nan) if c is None else fourier.resize(c, H) for c in series])
        orders = [-1 if c is None else fourier.highest(c) for c in series]
        about = units | {"layout": "mean, cos 1, sin 1, cos 2, ..."}
        data["coefficients"] = ((dimension, prefix + "row", "coordinate"), stack, about)
        data["highest_harmonic"] = (dimension, orders, {"units": "1", "long_name": "-1 where there is no series"})
    if len(some) == len(motions):
        return data
    data["form"] = (dimension, np.array([m.form for m in motions], dtype=str))
    for kind in OTHERS.values():
        stored = [m.numbers() if isinstance(m, kind) else {} for m in motions]
        for name in next(filter(None, stored), {}):
            rows = [numbers.get(name, np.empty(0)).ravel() for numbers in stored]
            padded = np.full((len(rows), max(map(len, rows))), np.nan)
            for i, row in enumerate(rows):
                padded[i, : len(row)] = row
            own = f"{kind.form.replace(' ', '_')}_{name}"
            data[own] = ((dimension, f"{prefix}{own}_entry"), padded, {"long_name": f"{name} of a {kind.__name__}"})
    return data


def unpack_motions(data: xr.Dataset, prefix: str) -> list[PeriodicMotion]:
    """Return the motions that `pack_motions` put into a dataset."""
    count = len(data[prefix + "omega"])
    forms = data[prefix + "form"].values if prefix + "form" in data else [FourierSeries.form] * count
    found: list[PeriodicMotion] = []
    for i, form in enumerate(map(str, forms)):
        if form == FourierSeries.form:
            H = int(data[prefix + "highest_harmonic"].values[i])
            found.append(FourierSeries(fourier.resize(data[prefix + "coefficients"].values[i], H)))
        else:
            kind = OTHERS[form]
            start = f"{prefix}{form.replace(' ', '_')}_"
            names = [str(name) for name in data.data_vars if str(name).startswith(start)]
            found.append(kind.of_numbers({name.removeprefix(start): _row(data[name].values[i]) for name in names}))
    return found


def _row(padded: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a row without its padding."""
    return np.array(padded[: 1 + np.flatnonzero(~np.isnan(padded))[-1]])


def pack_verdicts(judged: Sequence[Stability | None], dimension: str, prefix: str) -> dict[str, Any]:
    """Return the variables of the stability of orbits; none where none was judged."""
    if not any(judged):
        return {}
    data: dict[str, Any] = {
        "stability": (dimension, np.array([s.verdict if s else "" for s in judged], dtype=str)),
        "stability_reason": (dimension, np.array([s.reason if s else "" for s in judged], dtype=str)),
        "trivial_error": (dimension, [s.trivial_error if s else np.nan for s in judged], {"units": "1"}),
        "unstable": (dimension, [s.unstable if s else -1 for s in judged], {"units": "1"}),
    }
    critical = [None if s is None or s.critical is None else np.array([s.critical]) for s in judged]
    for name, second, rows in (
        ("multipliers", "multiplier", [s.multipliers if s else None for s in judged]),
        ("half_multipliers", "multiplier", [s.half_multipliers if s else None for s in judged]),
        ("critical", None, critical),
        ("mode", "state", [s.mode if s else None for s in judged]),
    ):
        data |= _pack_complex(name, rows, (dimension, prefix + second) if second else (dimension,))
    return data


def unpack_verdict(data: xr.Dataset, prefix: str, i: int) -> Stability | None:
    """Return the stability of an orbit in a dataset; None where it was not judged."""
    if prefix + "stability" not in data or not str(data[prefix + "stability"].values[i]):
        return None
    multipliers = _unpack_complex(data, prefix + "multipliers", i)
    critical = _unpack_complex(data, prefix + "critical", i)
    return Stability(
        str(data[prefix + "stability"].values[i]),
        np.empty(0, dtype=complex) if multipliers is None else multipliers,
        float(data[prefix + "trivial_error"].values[i]),
        int(data[prefix + "unstable"].values[i]),
        str(data[prefix + "stability_reason"].values[i]),
        _unpack_complex(data, prefix + "half_multipliers", i),
        None if critical is None else complex(critical[0]),
        _unpack_complex(data, prefix + "mode", i),
    )


def names_of(data: xr.Dataset) -> tuple[tuple[str, ...], Naming]:
    """Return the units of the coordinates, and the naming, of a dataset."""
    if "coordinate_unit" not in data.coords:  # files of version 0.1 hold the units of the coordinates only
        units = tuple(json.loads(data.attrs["units"]))
        return units, NAMELESS
    found: dict[str, dict[str, str]] = {"unit": {}, "description": {}}
    outputs = tuple(map(str, data["output"].values)) if "output" in data.coords else ()
    for kind in ("coordinate", "parameter", *(["output"] if outputs else [])):
        for what, texts in found.items():
            texts |= zip(map(str, data[kind].values), map(str, data[f"{kind}_{what}"].values), strict=True)
    units = tuple(found["unit"][str(c)] for c in data["coordinate"].values)
    known = [{name: text for name, text in texts.items() if text} for texts in found.values()]
    return units, Naming(known[0], known[1], outputs)


def labels_of(orbit: Orbit) -> dict[str, Any]:
    """Return the labels of the dimensions of a dataset of orbits: names, units and descriptions."""
    units = {**orbit.naming.units, **dict(zip(orbit.coordinates, orbit.units, strict=True))}
    labels: dict[str, Any] = {}
    kinds = {"coordinate": orbit.coordinates, "parameter": tuple(orbit.parameters)}
    if orbit.outputs:
        kinds["output"] = tuple(orbit.outputs)
    for kind, names in kinds.items():
        labels[kind] = list(names)
        for what, texts in (("unit", units), ("description", orbit.naming.descriptions)):
            labels[f"{kind}_{what}"] = (kind, np.array([texts.get(n, "") for n in names], dtype=str))
    return labels
