"""Criteria for designs: functions of parameters, eigenvalues, cycles and critical values, with exact gradients."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hbbogie.design.point import DesignPoint, Row, critical_rows
from hbbogie.equilibria.eigenvalues import Eigenvalues
from hbbogie.equilibria.linearisation import Linearisation
from hbbogie.errors import ModelError, unknown_name
from hbbogie.model.system import System

Array = NDArray[np.float64]


class Quantity(Protocol):
    """A quantity that can be limited, raised or lowered.

    Attributes
    ----------
    name, unit : str
    """

    @property
    def name(self) -> str:
        """Its name."""

    @property
    def unit(self) -> str:
        """Its unit."""

    def rows(self, point: DesignPoint) -> list[Row]:
        """Return its values with gradients; several if the quantity is the smallest (or largest) of several values."""


@dataclass(frozen=True, eq=False)
class Limit:
    """A limit on a quantity, which all its rows have to satisfy.

    Attributes
    ----------
    quantity : Quantity
    lower, upper : float, unit of the quantity
    """

    quantity: Quantity
    lower: float = -np.inf
    upper: float = np.inf

    def __post_init__(self) -> None:
        if not self.lower <= self.upper:
            raise ModelError(
                f"Limit on {self.quantity.name}: lower={self.lower:g}, upper={self.upper:g}; give lower <= upper."
            )


@dataclass(frozen=True, eq=False)
class CriticalValue:
    """The smallest critical value in the range: a row for each Hopf point and fold, and one for the range's end."""

    name: str = "critical value"
    unit: str = ""

    def rows(self, point: DesignPoint) -> list[Row]:
        """Return the rows."""
        return [row for row, _ in critical_rows(point)]


@dataclass(frozen=True, eq=False)
class Expression:
    """A function of the parameters.

    Attributes
    ----------
    name : str
    of : callable
        Parameters by name -> expression, such as ``lambda p: 2 * p["K2"] * p["d1"] ** 2``, which CasADi differentiates.
    unit : str
    """

    name: str
    of: Callable[[Mapping[str, Any]], Any]
    unit: str = ""

    def rows(self, point: DesignPoint) -> list[Row]:
        """Return the one row."""
        f, p = point.system.once(self, lambda: self.functions(point.system)), point.system.vector()
        value, gradient = f[0](p)

        def second(names: Sequence[str]) -> Array:
            places = [point.system.parameter_names.index(n) for n in names]
            return np.asarray(f[1](p).full()[np.ix_(places, places)])

        return [Row(self.name, float(value), gradient.full().ravel(), second)]

    def functions(self, system: System) -> tuple[ca.Function, ca.Function]:
        """Return p -> (value, gradient), and p -> second derivatives."""
        p = ca.SX.sym("p", len(system.parameters))
        try:
            value = ca.SX(self.of(dict(zip(system.parameter_names, ca.vertsplit(p), strict=True))))
        except KeyError as error:
            raise ModelError(
                f"{self.name}: {unknown_name('parameter', error.args[0], system.parameter_names)}"
            ) from None
        hessian = ca.Function("expression_hessian", [p], [ca.densify(ca.hessian(value, p)[0])])
        return ca.Function("expression", [p], [value, ca.densify(ca.gradient(value, p))]), hessian


def cost_of_change(system: System, names: Sequence[str]) -> Expression:
    """Return the cost of a change: 100 times the sum of the squared logarithms of the ratios to a system's values.

    Parameters
    ----------
    system : System
        Its values cost nothing.
    names : sequence of str
        Parameters with positive values.
    """
    before = {n: system.values[n] for n in names}
    return Expression("cost of change", lambda p: 100 * sum(ca.log(p[n] / v) ** 2 for n, v in before.items()), "1")


@dataclass(frozen=True, eq=False)
class DampingRatio:
    """The damping ratio of the oscillating modes of the equilibrium, -Re / abs of each eigenvalue, with a row for each.

    Attributes
    ----------
    at : float, unit of the parameter whose critical value is raised
        Value of that parameter, such as a service speed.
    """

    at: float
    unit: str = "1"

    @property
    def name(self) -> str:
        """Its name, with the value at which it is taken."""
        return f"damping ratio at {self.at:g}"

    def rows(self, point: DesignPoint) -> list[Row]:
        """Return the rows, in order of frequency."""
        system = point.system
        check_within(point, self.name, self.at)
        line = Linearisation(system, point.parameter)
        found = Eigenvalues(system, line.equilibrium(self.at), line.parameters(self.at))
        values = found.values
        modes = [i for i in np.argsort(np.abs(values)) if values[i].imag > 1e-9 * np.abs(values).max()]
        rows = []
        for k, i in enumerate(modes):
            gradient = _damping_slopes(values[i], found.slopes[i])
            gradient[line.place] = 0.0
            second = None if found.moving else partial(_damping_hessian, found, i)
            rows.append(Row(f"{self.name}, mode {k + 1}", float(-values[i].real / abs(values[i])), gradient, second))
        return rows


def check_within(point: DesignPoint, what: str, value: float) -> None:
    """Raise `ModelError` when a value of the parameter lies outside its bounds."""
    low, high = point.system.parameter(point.parameter).bounds
    if not low <= value <= high:
        raise ModelError(
            f"{what}: {point.parameter} = {value:g} lies outside the bounds ({low:g}, {high:g}) of "
            f"{point.parameter!r}; give a value within."
        )


def _damping_slopes(value: complex, slopes: NDArray[np.complex128]) -> Array:
    """Return the derivatives of -cos(arg value) = -Re(value) / abs(value) from those of ln(value)."""
    angle = np.angle(value)
    return np.asarray(np.sin(angle) * (slopes / value).imag)


def _damping_hessian(found: Eigenvalues, i: int, names: Sequence[str]) -> Array:
    places = [found.system.parameter_names.index(n) for n in names]
    value, slopes = found.values[i], found.slopes[i][places] / found.values[i]
    turn, angle = slopes.imag, np.angle(value)
    turned = (found.hessian(i, places) / value - np.outer(slopes, slopes)).imag
    return np.asarray(np.cos(angle) * np.outer(turn, turn) + np.sin(angle) * turned)
