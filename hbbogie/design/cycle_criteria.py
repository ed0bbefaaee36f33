"""Criteria on the hunting cycle: peak and root mean square of what moves in it, with exact gradients."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from hbbogie.design.criteria import check_within
from hbbogie.design.point import DesignPoint, Row, critical_rows, stable_cycle
from hbbogie.errors import ModelError
from hbbogie.methods.equations import Equations
from hbbogie.results import Orbit
from hbbogie.solving.measures import measured

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class OnCycle:
    """What the criteria on the hunting cycle share: where the cycle is taken, and the total derivative.

    Attributes
    ----------
    of : str
        Name of what moves.
    at : float, unit of the parameter whose critical value is raised
        The value at which the cycle is taken. Give either this or
    overspeed : float
        the fraction by which this value exceeds the smallest critical value. The derivative follows that value.
    unit : str
    """

    of: str
    at: float | None = None
    overspeed: float | None = None
    unit: str = ""

    what: ClassVar[str] = ""

    def __post_init__(self) -> None:
        kind = type(self).__name__
        if (self.at is None) == (self.overspeed is None):
            raise ModelError(f"{kind} of {self.of!r}: give either at= (a value) or overspeed= (a share), not both.")
        if self.overspeed is not None and not self.overspeed > 0:
            raise ModelError(
                f"{kind} of {self.of!r}: overspeed={self.overspeed:g}; give a positive share, such as 0.1."
            )

    @property
    def name(self) -> str:
        """Its name, with the value at which it is taken."""
        where = f"at {self.at:g}" if self.at is not None else f"at {100 * (self.overspeed or 0):g} % overspeed"
        return f"{self.what} of {self.of} {where}"

    def measured(self, equations: Equations, cycle: Orbit, z: Array, p: Array) -> tuple[float, Array]:
        """Return the value for a cycle, and its derivatives in (z, p)."""
        raise NotImplementedError

    def rows(self, point: DesignPoint) -> list[Row]:
        """Return the one row, or none if there is no cycle."""
        share = self.overspeed or 0.0
        value = self.at if self.at is not None else point.beyond(share)
        check_within(point, self.name, value)
        cycle = stable_cycle(point, self, value) if value >= point.value else None
        if cycle is None:
            return []
        equations = point.equations.phased(cycle)
        z, p = equations.encode(cycle), point.system.vector(**{point.parameter: value})
        measured, d = self.measured(equations, cycle, z, p)
        J = equations.derivatives(tuple(range(len(p))))(z, p)[1].full()
        m = equations.size
        gradient = d[m:] - J[:, m:].T @ np.linalg.solve(J[:, :m].T, d[:m])
        place = point.system.parameter_names.index(point.parameter)
        along, gradient[place] = gradient[place], 0.0
        if self.overspeed is not None:
            smallest = min((row for row, _ in critical_rows(point)), key=lambda row: row.value)
            gradient = gradient + along * (1 + share * np.sign(point.value)) * smallest.gradient
        return [Row(self.name, measured, gradient)]


@dataclass(frozen=True, eq=False)
class RootMeanSquare(OnCycle):
    """The root of the mean square, over the period of the hunting cycle, of a coordinate or of an output.

    Attributes
    ----------
    of : str
        Name of a coordinate or of an output, such as "frame lateral acceleration".
    at : float, unit of the parameter whose critical value is raised
        The value at which it is taken. Give either this or
    overspeed : float
        the fraction by which this value exceeds the smallest critical value. The derivative follows that value.
    unit : str

    Notes
    -----
    The mean over 512 samples is taken for outputs. Cycle and total derivative are those of `Peak`.
    """

    what: ClassVar[str] = "rms"

    def measured(self, equations: Equations, cycle: Orbit, z: Array, p: Array) -> tuple[float, Array]:
        """Return the value for a cycle, and its derivatives in (z, p)."""
        return measured(equations, "rms", self.of, cycle, z, p)


@dataclass(frozen=True, eq=False)
class Peak(OnCycle):
    """The largest absolute value of a coordinate, element or output over the period of the hunting cycle.

    Attributes
    ----------
    of : str
        Name of a coordinate, of an element or of an output, such as "q1" or "front flange".
    at : float, unit of the parameter whose critical value is raised
        The value at which the peak is taken. Give either this or
    overspeed : float
        the fraction by which this value exceeds the smallest critical value. The derivative follows that value.
    unit : str

    Notes
    -----
    The cycle solves F(z, p) = 0, so dz/dp = -F_z^-1 F_p. At its maximum the signal does not vary with the phase, so the
    phase may be held fixed. If there are several cycles, the stable one is taken, and if there are several stable ones,
    the largest. If there is no cycle there is no row, and a limit counts as satisfied. Where the peak is at a kink of
    an output, the phase may not be held fixed, and a `ConvergenceError` says so.
    """

    what: ClassVar[str] = "peak"

    def measured(self, equations: Equations, cycle: Orbit, z: Array, p: Array) -> tuple[float, Array]:
        """Return the value for a cycle, and its derivatives in (z, p)."""
        return measured(equations, "peak", self.of, cycle, z, p)
