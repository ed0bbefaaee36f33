"""Signals: what the named outputs of a system do along an orbit, with their numbers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import wraps
from operator import attrgetter
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hbbogie import fourier
from hbbogie.brief import lines
from hbbogie.errors import ModelError, named, pair
from hbbogie.units import readable

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]
BAND = 2.0  # Hz to either side of a frequency, by default
NUMBERS = ("peak", "mean", "half peak to peak", "rms", "first harmonic")
Number = Callable[[Any, str], float]


@dataclass(frozen=True, eq=False)
class Signal:
    """An output along an orbit.

    Attributes
    ----------
    name, unit, description : str
    omega : float, rad/s
    samples : ndarray, shape (N,), unit of the output
        At N = 256 equidistant times of the period, the first at t = 0.
    coefficients : ndarray, shape (2 K + 1,), unit of the output
        Of the harmonics 0 to K, in the order of an orbit's: integrals over the period, not of the samples.
    smallest, largest : float, unit of the output
        Over the period. Looked for about the extreme of some thousand instants with steps that shrink to 1e-6 of the
        period, so that a peak at a kink is met too; a contact shorter than a thousandth of the period may be missed.
    mean_square : float, unit of the output squared
        By integration that is refined at kinks and jumps to about 1e-9 of its value.
    exact : callable or None
        Times t [s], shape (N,) -> values, shape (N,); None in results read from a file.
    """

    name: str
    unit: str
    description: str
    omega: float
    samples: Array
    coefficients: Array
    smallest: float
    largest: float
    mean_square: float
    exact: Callable[[Array], Array] | None = field(default=None, repr=False)

    def at(self, t: ArrayLike) -> Array:
        """Return the output at the times t [s], shape (len(t),) [its unit].

        From a file, values between the samples lie on straight lines.
        """
        times = np.atleast_1d(np.asarray(t, dtype=float))
        if self.exact is not None:
            return self.exact(times)
        N = len(self.samples)
        return np.interp(self.omega * times / (2 * np.pi) * N, np.arange(N), self.samples, period=N)

    def number(self, quantity: str) -> float:
        """Return a number by its name: one of "peak", "mean", "half peak to peak", "rms" and "first harmonic"."""
        value: float = getattr(self, named("signal", "quantity", quantity, NUMBERS).replace(" ", "_"))
        return value

    @property
    def peak(self) -> float:
        """Largest absolute value over the period [its unit]."""
        return max(abs(self.smallest), abs(self.largest))

    @property
    def mean(self) -> float:
        """Mean over the period [its unit]."""
        return float(self.coefficients[0])

    @property
    def half_peak_to_peak(self) -> float:
        """Half the distance from the smallest to the largest value [its unit]."""
        return (self.largest - self.smallest) / 2

    @property
    def rms(self) -> float:
        """Root of the mean square over the period, the mean included [its unit]."""
        return float(np.sqrt(self.mean_square))

    @property
    def highest(self) -> int:
        """Highest harmonic K kept."""
        return fourier.highest(self.coefficients)

    @property
    def spectrum(self) -> Array:
        """Amplitude of each harmonic 0 ... K, shape (K + 1,) [its unit]."""
        return np.r_[abs(self.coefficients[0]), np.hypot(self.coefficients[1::2], self.coefficients[2::2])]

    @property
    def first_harmonic(self) -> float:
        """Amplitude of the first harmonic [its unit]; 0 for an equilibrium."""
        return float(self.spectrum[1]) if self.omega else 0.0

    def rms_within(self, low: float, high: float) -> float:
        """Return the root mean square of what lies in a band of frequencies, as an ideal filter leaves it.

        Parameters
        ----------
        low, high : float, Hz
            Both included. The harmonics within count, h times the frequency of the orbit; the mean where low is 0.

        Raises
        ------
        ModelError
            When the band is none, or reaches beyond the harmonics kept.
        """
        low, high = pair("rms_within: the band", (low, high))
        f = self.omega / (2 * np.pi)
        K = self.highest
        if low < 0 or (f and high >= (K + 1) * f):
            raise ModelError(
                f"rms_within: the band from {low:g} to {high:g} Hz; give one from 0 Hz to below {(K + 1) * f:g} Hz, "
                f"which is harmonic {K + 1} of {self.name!r}."
            )
        own = np.arange(K + 1) * f
        inside = (own >= low * (1 - 1e-9)) & (own <= high * (1 + 1e-9))
        squares = self.spectrum**2 / np.r_[1.0, np.full(K, 2.0)]
        return float(np.sqrt(squares[inside].sum()))

    def rms_about(self, frequency: float | None = None, width: float = BAND) -> float:
        """Return the root mean square of the harmonics within a width about a frequency, as filters of practice do.

        Parameters
        ----------
        frequency : float, Hz
            That of the orbit where left out.
        width : float, Hz
            To either side.
        """
        f = self.omega / (2 * np.pi) if frequency is None else frequency
        return self.rms_within(max(f - width, 1e-6 * f), f + width)  # without the mean, unless about 0

    def __repr__(self) -> str:
        factor, unit = readable(self.unit, max(self.peak, self.rms))
        zero = 1e-9 * self.peak  # what is zero to round-off
        shown = {what: self.number(what) for what in NUMBERS}
        text = ", ".join(f"{what} {0.0 if abs(x) < zero else factor * x:.5g}" for what, x in shown.items())
        meaning = f": {self.description}" if self.description else ""
        return lines(
            f"{self.name}{meaning}",
            text + ("" if unit in ("", "1") else f" [{unit}]"),
        )


def or_output(quantity: str) -> Callable[[Number], Number]:
    """Let a method (orbit, name of a coordinate) -> number give this one of `NUMBERS` for the name of an output."""

    def dress(method: Number) -> Number:
        @wraps(method)
        def number(orbit: Any, name: str) -> float:
            return orbit.output(name).number(quantity) if orbit.naming.is_output(name) else method(orbit, name)

        return number

    return dress


def pack_signals(records: Sequence[Mapping[str, Signal]], dimension: str, row: str) -> dict[str, Any]:
    """Return the variables of the outputs of several orbits; none where there are no outputs.

    Parameters
    ----------
    records : sequence of mapping
        The outputs of each orbit by name, all of the same names.
    dimension, row : str
        Of the orbits, and of the coefficients.
    """
    rows = [list(record.values()) for record in records]
    if not records or not rows[0]:
        return {}
    K = max(len(s.coefficients) for row in rows for s in row) // 2
    units = {"units": "those of output_unit"}

    def table(value: Callable[[Signal], Any]) -> Any:
        return np.array([[value(s) for s in row] for row in rows])

    return {
        "output_samples": ((dimension, "output", "sample"), table(attrgetter("samples")), units),
        "output_coefficients": (
            (dimension, "output", row),
            table(lambda s: fourier.resize(s.coefficients, K)),
            units | {"layout": "mean, cos 1, sin 1, cos 2, ..."},
        ),
        **{
            f"output_{name}": ((dimension, "output"), table(attrgetter(name)), units)
            for name in ("smallest", "largest", "mean_square")
        },
    }


def unpack_signals(data: xr.Dataset, prefix: str, i: int, omega: float) -> dict[str, Signal] | None:
    """Return the outputs of orbit i that `pack_signals` put into a dataset; None where there are none."""
    if f"{prefix}output_samples" not in data:
        return None
    get = {n: data[f"{prefix}output_{n}"].values[i] for n in ("samples", "coefficients", "smallest", "largest")}
    squares = data[f"{prefix}output_mean_square"].values[i]
    labels = [list(map(str, data[n].values)) for n in ("output", "output_unit", "output_description")]
    return {
        name: Signal(
            name, unit, meaning, omega, get["samples"][k], get["coefficients"][k],
            float(get["smallest"][k]), float(get["largest"][k]), float(squares[k]),
        )
        for k, (name, unit, meaning) in enumerate(zip(*labels, strict=True))
    }  # fmt: skip
