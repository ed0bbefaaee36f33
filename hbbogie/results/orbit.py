"""Orbits and their stability, and their layout in a labelled dataset."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hbbogie.brief import lines
from hbbogie.errors import named
from hbbogie.results.measuring import measured, measured_as
from hbbogie.results.naming import NAMELESS, Naming
from hbbogie.results.netcdf import read, write
from hbbogie.results.periodic import FourierSeries, PeriodicMotion, series_of
from hbbogie.results.pictures import draw, page
from hbbogie.results.signal import Signal, or_output
from hbbogie.results.stability import Stability
from hbbogie.results.stored import fields_of, labels_of, pack
from hbbogie.units import behind, per_second, readable

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]
PEAKS = 8  # shown at most
NOT_RESOLVED = "not resolved"  # what the status of a fold says that more harmonics may move or remove


@dataclass(frozen=True, eq=False)
class Orbit:
    """A periodic motion, or an equilibrium (H = 0).

    The motion is stored as its method found it: as Fourier coefficients, as phases that are linear between switchings,
    or as a piecewise polynomial. An orbit answers the same questions whichever it is.

    An angle may run on: ``q(t + T) = q(t) + advance``. The motion stored is then its periodic part, and `q` adds
    ``advance t / T``. Peak, extremes, root mean square and spectrum are those of the periodic part about its mean,
    which depends on where time begins.

    Attributes
    ----------
    system : str
        Name of the system.
    coordinates, units : tuple of str
        Names and units of the n coordinates.
    motion : FourierSeries, LinearPhases or PiecewisePolynomial
        The coordinates over the phase omega t; an array, shape (2 H + 1, n), counts as Fourier coefficients (see
        ``coefficients``).
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
        Units and descriptions of coordinates, parameters and outputs, as far as they are known.
    advance : tuple of float, unit of the coordinate
        By how much each coordinate has grown after a period: whole turns of those that run on, 0 of the others. Empty
        where none runs on.
    recorded : mapping of Signal, or None
        The outputs by name, in an orbit read from a file; at a Hopf point, those of the equilibrium.
    """

    system: str
    coordinates: tuple[str, ...]
    units: tuple[str, ...]
    motion: PeriodicMotion
    omega: float
    parameters: dict[str, float]
    method: str = ""
    residual: float = float("nan")
    status: str = ""
    stability: Stability | None = None
    errors: dict[str, float] | None = None
    naming: Naming = NAMELESS
    advance: tuple[float, ...] = ()
    recorded: Mapping[str, Signal] | None = None

    def __post_init__(self) -> None:
        if not hasattr(self.motion, "at"):  # Fourier coefficients
            object.__setattr__(self, "motion", series_of(self.motion))

    @property
    def H(self) -> int:
        """Highest harmonic of ``coefficients``; 0 for an equilibrium."""
        return self.motion.H

    @property
    def kept(self) -> int | None:
        """Highest harmonic where the motion is stored as a Fourier series; None where it is not."""
        return self.H if isinstance(self.motion, FourierSeries) else None

    @cached_property
    def coefficients(self) -> Array:
        """Fourier coefficients, shape (2 H + 1, n) [unit of the coordinate].

        ``q(t) = c[0] + sum_h c[2 h - 1] cos(h omega t) + c[2 h] sin(h omega t)``, which is the motion where it is
        stored so, and its series cut off after harmonic H otherwise.
        """
        return self.motion.coefficients(self.H)

    def harmonics(self, H: int) -> Array:
        """Return the Fourier coefficients up to harmonic H, shape (2 H + 1, n) [unit of the coordinate]."""
        return self.motion.coefficients(H)

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
    def outputs(self) -> Mapping[str, Signal]:
        """The outputs that the system names, by name, measured along the orbit; none where it names none."""
        return measured(self) if self.recorded is None else self.recorded

    def output(self, name: str) -> Signal:
        """Return an output of the system along the orbit, by its name."""
        return measured_as(self, named(f"orbit of {self.system!r}", "output", name, self.naming.outputs))

    @property
    def extremes(self) -> tuple[Array, Array]:
        """Smallest and largest value of each coordinate over the period, each of shape (n,) [its unit]."""
        low, high = self.motion.extremes
        return (low - self.free_mean, high - self.free_mean) if self.advance else (low, high)

    @property
    def free_mean(self) -> Array:
        """Mean of the periodic part of each coordinate that runs on, 0 of the others, shape (n,) [its unit]."""
        return np.where(self.advance, self.motion.mean(), 0.0) if self.advance else np.zeros(len(self.coordinates))

    def about_mean(self, coefficients: Array) -> Array:
        """Return coefficients, shape (2 H + 1, n), with zero means of the coordinates that run on."""
        if not self.advance:
            return coefficients
        c = coefficients.copy()
        c[0, np.array(self.advance) != 0] = 0.0
        return c

    def mean_speed(self, coordinate: str) -> float:
        """Return the mean velocity of a coordinate [its unit/s]: 0 unless it runs on."""
        return self.advance[self.index(coordinate)] / self.period if self.advance else 0.0

    @or_output("peak")
    def amplitude(self, coordinate: str) -> float:
        """Return the peak, the largest absolute value over the period, of a coordinate or output [its unit]."""
        i = self.index(coordinate)
        low, high = self.extremes
        return float(max(-low[i], high[i]))

    @or_output("half peak to peak")
    def half_peak_to_peak(self, coordinate: str) -> float:
        """Return half the distance from the smallest to the largest value of a coordinate or output [its unit]."""
        low, high = self.extremes
        return float(high[self.index(coordinate)] - low[self.index(coordinate)]) / 2

    @or_output("mean")
    def mean(self, coordinate: str) -> float:
        """Return the mean of a coordinate or output over the period [its unit]."""
        return float(self.motion.mean()[self.index(coordinate)])

    @or_output("rms")
    def rms(self, coordinate: str) -> float:
        """Return the root mean square of a coordinate or output over the period [its unit]."""
        i = self.index(coordinate)
        return float(np.sqrt(max(self.motion.rms()[i] ** 2 - self.free_mean[i] ** 2, 0.0)))

    @or_output("first harmonic")
    def first_harmonic(self, coordinate: str) -> float:
        """Return the amplitude of the first harmonic of a coordinate or output [its unit]; 0 for an equilibrium."""
        return float(np.hypot(*self.coefficients[1:3, self.index(coordinate)])) if self.H else 0.0

    def spectrum(self, coordinate: str) -> Array:
        """Return the amplitude of each harmonic 0 ... H of a coordinate or output, shape (H + 1,) [its unit]."""
        if self.naming.is_output(coordinate):
            return self.output(coordinate).spectrum[: self.H + 1]
        c = self.about_mean(self.coefficients)[:, self.index(coordinate)]
        return np.r_[abs(c[0]), np.hypot(c[1::2], c[2::2])]

    @property
    def tail(self) -> float:
        """Largest coefficient of the four highest harmonics, relative to the largest of all [1].

        A hint whether the harmonics kept resolve the motion; 0 for an equilibrium, and where no harmonics were left out
        because the motion is stored in another form.
        """
        moving = np.abs(self.motion.c[1:]) if isinstance(self.motion, FourierSeries) else np.zeros(1)
        largest = max(moving.max(initial=0.0), *np.abs(self.advance), 0.0)
        return float(moving[-8:].max() / largest) if self.H and largest > 0 else 0.0

    def is_odd(self, tolerance: float = 1e-9) -> bool:
        """Tell whether q(t + T / 2) = -q(t), up to a distance relative to the largest value."""
        return not self.advance and self.motion.is_odd(tolerance)

    def at(self, tau: ArrayLike, derivative: int = 0) -> Array:
        """Return the coordinates, or a derivative of theirs in tau, at the phases tau [rad], shape (len(tau), n)."""
        tau = np.atleast_1d(np.asarray(tau, dtype=float))
        x = self.motion.at(tau, derivative)
        if self.advance and derivative < 2:  # eq-running
            x = x + np.outer(np.ones_like(tau) if derivative else tau, np.array(self.advance) / (2 * np.pi))
        return x

    def q(self, t: ArrayLike) -> Array:
        """Return the coordinates at the times t [s], shape (len(t), n)."""
        return self.at(self.omega * np.asarray(t, dtype=float))

    def v(self, t: ArrayLike) -> Array:
        """Return the velocities at the times t [s], shape (len(t), n)."""
        return self.omega * self.at(self.omega * np.asarray(t, dtype=float), 1)

    def a(self, t: ArrayLike) -> Array:
        """Return the accelerations at the times t [s], shape (len(t), n)."""
        return self.omega**2 * self.at(self.omega * np.asarray(t, dtype=float), 2)

    def times(self) -> Array:
        """Return times from 0 to the period, close where the motion is fast, shape (K,) [s]; 0 for an equilibrium."""
        return self.motion.phases() / self.omega if self.H else np.zeros(1)

    def replace(self, **changes: Any) -> Orbit:
        """Return the orbit with some fields changed.

        A new ``omega`` runs through the same motion at another frequency. New ``coefficients`` take the place of the
        ``motion``, in whichever form that was.
        """
        if "coefficients" in changes:
            changes["motion"] = series_of(changes.pop("coefficients"))
        moved = changes.keys() & {"motion", "omega", "parameters", "naming"}
        return replace(self, **({"recorded": None} if moved else {}) | changes)

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
            found[name] = f"{factor * peak:.4g}{behind(unit)}"
        return found

    def __repr__(self) -> str:
        kind = "cycle" if self.H else "equilibrium"
        judged = self.stability.verdict if self.stability else "not judged"
        peaks = list(self.peaks().items())
        shown = ", ".join(f"{name} {text}".strip() for name, text in peaks[:PEAKS])
        largest, running = self.largest_multiplier, zip(self.coordinates, self.units, self.advance, strict=False)
        series = "" if self.kept is None else f"highest harmonic {self.kept}, "
        return lines(
            f"{self.system}: {kind}, {judged}, at {self.naming.values(self.parameters)}".removesuffix(", at "),
            f"period {self.period:.7g} s, omega {self.omega:.7g} rad/s, {self.frequency:.6g} Hz" if self.H else "",
            f"peaks {shown}" + (f" and {len(peaks) - PEAKS} more" if len(peaks) > PEAKS else ""),
            *(f"{c} runs on, mean speed {self.mean_speed(c):.6g} {per_second(u)}" for c, u, by in running if by),
            f"{self.method or 'no method named'}, {series}residual {self.residual:.1g}",
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
            **({"mean_speed": {c: self.mean_speed(c) for c in self.coordinates}} if self.advance else {}),
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


def unpack(data: xr.Dataset, prefix: str = "") -> list[Orbit]:
    """Return the orbits that `pack` put into a dataset."""
    return [Orbit(**fields) for fields in fields_of(data, prefix)]
