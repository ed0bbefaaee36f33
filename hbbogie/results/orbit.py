"""Orbits and their stability, and their layout in a labelled dataset."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hbbogie import fourier
from hbbogie.brief import lines
from hbbogie.errors import named
from hbbogie.results.naming import NAMELESS, Naming
from hbbogie.results.netcdf import _pack_complex, _unpack_complex, read, write
from hbbogie.results.pictures import draw, page
from hbbogie.results.stability import Stability
from hbbogie.units import readable

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]
PEAKS = 8  # shown at most
NOT_RESOLVED = "not resolved"  # what the status of a fold says that more harmonics may move or remove


@dataclass(frozen=True, eq=False)
class Orbit:
    """A periodic motion, or an equilibrium (H = 0), as Fourier coefficients.

    ``q(t) = c[0] + sum_h c[2 h - 1] cos(h omega t) + c[2 h] sin(h omega t)``

    Attributes
    ----------
    system : str
        Name of the system.
    coordinates, units : tuple of str
        Names and units of the n coordinates.
    coefficients : ndarray, shape (2 H + 1, n), unit of the coordinate
    omega : float, rad/s
    parameters : dict
        Value of every parameter of the system.
    method : str
        How it was computed.
    residual : float
        Largest scaled residual of the method's equations.
    status : str
        A sentence on how the solve ended.
    stability : Stability or None
        None where it was not asked for.
    errors : dict of float, or None
        Error estimates from shooting: "omega" [rad/s], "waveform" (largest distance relative to the peak), and the
        error of each coordinate's peak by its name [its unit]. None where they were not asked for or not found.
    naming : Naming
        Units and descriptions of coordinates and parameters, as far as they are known.
    """

    system: str
    coordinates: tuple[str, ...]
    units: tuple[str, ...]
    coefficients: Array
    omega: float
    parameters: dict[str, float]
    method: str = ""
    residual: float = float("nan")
    status: str = ""
    stability: Stability | None = None
    errors: dict[str, float] | None = None
    naming: Naming = NAMELESS

    @property
    def H(self) -> int:
        """Highest harmonic."""
        return fourier.highest(self.coefficients)

    @property
    def period(self) -> float:
        """Period 2 pi / omega [s]; infinite for an equilibrium."""
        return 2 * np.pi / self.omega if self.omega else float("inf")

    @property
    def frequency(self) -> float:
        """Frequency omega / (2 pi) [Hz]."""
        return self.omega / (2 * np.pi)

    def index(self, coordinate: str) -> int:
        """Return the place of a coordinate, by its name."""
        name = named(f"orbit of {self.system!r}", "coordinate", coordinate, self.coordinates)
        return self.coordinates.index(name)

    @cached_property
    def extremes(self) -> tuple[Array, Array]:
        """Smallest and largest value of each coordinate over the period, each of shape (n,) [its unit]."""
        return fourier.extremes(self.coefficients)

    def amplitude(self, coordinate: str) -> float:
        """Return the peak, the largest absolute value over the period, of a coordinate [its unit]."""
        i = self.index(coordinate)
        low, high = self.extremes
        return float(max(-low[i], high[i]))

    def first_harmonic(self, coordinate: str) -> float:
        """Return the amplitude of the first harmonic of a coordinate [its unit]; 0 for an equilibrium."""
        return float(np.hypot(*self.coefficients[1:3, self.index(coordinate)])) if self.H else 0.0

    def spectrum(self, coordinate: str) -> Array:
        """Return the amplitude of each harmonic 0 ... H of a coordinate, shape (H + 1,) [its unit]."""
        c = self.coefficients[:, self.index(coordinate)]
        return np.r_[abs(c[0]), np.hypot(c[1::2], c[2::2])]

    @property
    def tail(self) -> float:
        """Largest coefficient of the four highest harmonics, relative to the largest of all [1].

        A hint whether the harmonics kept resolve the motion; 0 for an equilibrium.
        """
        moving = np.abs(self.coefficients[1:])
        return float(moving[-8:].max() / moving.max()) if self.H and moving.max() > 0 else 0.0

    def q(self, t: ArrayLike) -> Array:
        """Return the coordinates at the times t [s], shape (len(t), n)."""
        return fourier.synthesis(self.H, self.omega * np.atleast_1d(t)) @ self.coefficients

    def v(self, t: ArrayLike) -> Array:
        """Return the velocities at the times t [s], shape (len(t), n)."""
        return self.omega * fourier.synthesis(self.H, self.omega * np.atleast_1d(t), 1) @ self.coefficients

    def replace(self, **changes: Any) -> Orbit:
        """Return the orbit with some fields changed."""
        return replace(self, **changes)

    @property
    def largest_multiplier(self) -> float | None:
        """Modulus of the largest multiplier but the trivial one; None where it is not known."""
        return self.stability.largest(cycle=bool(self.H)) if self.stability else None

    @property
    def verdict(self) -> str:
        """The verdict on its stability; "unknown" where none was asked for."""
        return self.stability.verdict if self.stability else "unknown"

    def peaks(self) -> dict[str, str]:
        """Return the peak of each coordinate in words, such as "10.01 mm", by its name."""
        found = {}
        for name, own in zip(self.coordinates, self.units, strict=True):
            factor, unit = readable(own, peak := self.amplitude(name))
            found[name] = f"{factor * peak:.4g}{'' if unit in ('', '1') else ' ' + unit}"
        return found

    def __repr__(self) -> str:
        kind = "cycle" if self.H else "equilibrium"
        judged = self.stability.verdict if self.stability else "not judged"
        peaks = list(self.peaks().items())
        shown = ", ".join(f"{name} {text}".strip() for name, text in peaks[:PEAKS])
        largest = self.largest_multiplier
        return lines(
            f"{self.system}: {kind}, {judged}, at {self.naming.values(self.parameters)}".removesuffix(", at "),
            f"period {self.period:.7g} s, omega {self.omega:.7g} rad/s, {self.frequency:.6g} Hz" if self.H else "",
            f"peaks {shown}" + (f" and {len(peaks) - PEAKS} more" if len(peaks) > PEAKS else ""),
            f"{self.method or 'no method named'}, highest harmonic {self.H}, residual {self.residual:.1g}",
            f"error of the waveform {self.errors['waveform']:.1g} of its peak" if self.errors else "",
            "" if largest is None else f"largest multiplier {largest:.6g}",
            self.stability.reason if self.stability else "",
            self.status,
        )

    def _repr_html_(self) -> str:
        rows = [["coordinate", "peak"], *([self.naming.plain(c), text] for c, text in self.peaks().items())]
        return page(repr(self), rows[: 1 + PEAKS], "orbit", self) if self.H else page(repr(self), rows[: 1 + PEAKS])

    def plot(self, **options: Any) -> Any:
        """Draw the phase portrait; options and the axes returned as of `hbbogie.plot.orbit`."""
        return draw("orbit", self, **options)

    def summary(self) -> dict[str, Any]:
        """Return the main numbers: frequency, period, peaks, first harmonics, parameters, verdict."""
        return {
            "system": self.system,
            "method": self.method,
            "status": self.status,
            "omega_rad_s": self.omega,
            "frequency_Hz": self.frequency,
            "period_s": self.period,
            "amplitude": {c: self.amplitude(c) for c in self.coordinates},
            "first_harmonic": {c: self.first_harmonic(c) for c in self.coordinates},
            "unit": dict(zip(self.coordinates, self.units, strict=True)),
            "stability": self.stability.verdict if self.stability else None,
            "multipliers": [[m.real, m.imag] for m in self.stability.multipliers.tolist()] if self.stability else None,
            "residual": self.residual,
            "tail": self.tail,
            "errors": self.errors,
            "parameters": dict(self.parameters),
        }

    def to_dataset(self) -> xr.Dataset:
        """Return the orbit as a labelled dataset."""
        import xarray as xr

        return xr.Dataset(pack([self], "point"), labels_of(self), {"system": self.system})

    def save(self, path: str | Path) -> None:
        """Write the orbit to a NetCDF file."""
        write(self.to_dataset(), path)

    @staticmethod
    def load(path: str | Path) -> Orbit:
        """Read an orbit from a NetCDF file written by `save`.

        Raises
        ------
        ModelError
            When the file is not there or was not written by `save`.
        """
        return read(path, lambda data: unpack(data)[0])


def pack(orbits: Sequence[Orbit], dimension: str, prefix: str = "") -> dict[str, Any]:
    """Return the variables of orbits of one system, padded to one highest harmonic."""
    H = max(o.H for o in orbits)
    row = "row" if not prefix else prefix + "row"
    stack = np.array([fourier.resize(o.coefficients, H) for o in orbits])
    units = set(orbits[0].units)
    own = {"units": (units.pop() or "1") if len(units) == 1 else "those of coordinate_unit"}
    data: dict[str, Any] = {
        "coefficients": ((dimension, row, "coordinate"), stack, own | {"layout": "mean, cos 1, sin 1, cos 2, ..."}),
        "highest_harmonic": (dimension, [o.H for o in orbits], {"units": "1"}),
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
    if any(o.stability for o in orbits):
        judged = [o.stability for o in orbits]
        data |= {
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
    return {prefix + name: value for name, value in data.items()}


def unpack(data: xr.Dataset, prefix: str = "") -> list[Orbit]:
    """Return the orbits that `pack` put into a dataset."""
    get = {name: data[prefix + name].values for name in ("coefficients", "highest_harmonic", "omega", "parameters")}
    coordinates = tuple(str(c) for c in data["coordinate"].values)
    names = [str(p) for p in data["parameter"].values]
    units, naming = _named(data)
    orbits = []
    for i in range(len(get["omega"])):
        orbits.append(
            Orbit(
                system=str(data.attrs["system"]),
                coordinates=coordinates,
                units=units,
                coefficients=fourier.resize(get["coefficients"][i], int(get["highest_harmonic"][i])),
                omega=float(get["omega"][i]),
                parameters=dict(zip(names, map(float, get["parameters"][i]), strict=True)),
                method=str(data[prefix + "method"].values[i]),
                residual=float(data[prefix + "residual"].values[i]),
                status=str(data[prefix + "status"].values[i]),
                stability=_judged(data, prefix, i),
                errors=json.loads(str(data[prefix + "errors"].values[i])) if prefix + "errors" in data else None,
                naming=naming,
            )
        )
    return orbits


def _judged(data: xr.Dataset, prefix: str, i: int) -> Stability | None:
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


def _named(data: xr.Dataset) -> tuple[tuple[str, ...], Naming]:
    """Return the units of the coordinates, and the naming, of a dataset."""
    if "coordinate_unit" not in data.coords:  # files of version 0.1 hold the units of the coordinates only
        units = tuple(json.loads(data.attrs["units"]))
        return units, NAMELESS
    found: dict[str, dict[str, str]] = {"unit": {}, "description": {}}
    for kind in ("coordinate", "parameter"):
        for what, texts in found.items():
            texts |= zip(map(str, data[kind].values), map(str, data[f"{kind}_{what}"].values), strict=True)
    units = tuple(found["unit"][str(c)] for c in data["coordinate"].values)
    known = [{name: text for name, text in texts.items() if text} for texts in found.values()]
    return units, Naming(*known)


def labels_of(orbit: Orbit) -> dict[str, Any]:
    """Return the labels of the dimensions of a dataset of orbits: names, units and descriptions."""
    units = {**orbit.naming.units, **dict(zip(orbit.coordinates, orbit.units, strict=True))}
    labels: dict[str, Any] = {}
    for kind, names in (("coordinate", orbit.coordinates), ("parameter", tuple(orbit.parameters))):
        labels[kind] = list(names)
        for what, texts in (("unit", units), ("description", orbit.naming.descriptions)):
            labels[f"{kind}_{what}"] = (kind, np.array([texts.get(n, "") for n in names], dtype=str))
    return labels
