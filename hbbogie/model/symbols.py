"""Symbols of a model: coordinates with their time derivatives, and parameters."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from hbbogie.errors import ModelError

Bounds = tuple[float, float]


class Coordinate(ca.SX):
    """A coordinate; an expression in the equations, with ``.dot`` and ``.ddot`` as time derivatives.

    Parameters
    ----------
    name : str
    unit : str
        Unit of the coordinate, such as "m" or "rad".
    description : str
    bounds : (float, float), unit of the coordinate
        Smallest and largest value that has a meaning, both included, such as (0, inf) for a concentration: equilibria
        are looked for within them only, and finite ones say how large the coordinate becomes.

    Raises
    ------
    ModelError
        When the bounds are not (low, high) with low < high.
    """

    def __init__(self, name: str, unit: str = "", description: str = "", bounds: Bounds = (-np.inf, np.inf)):
        super().__init__(ca.SX.sym(name))
        self.name, self.unit, self.description = name, unit, description
        self.bounds = (float(bounds[0]), float(bounds[1]))
        if not self.bounds[0] < self.bounds[1]:
            raise ModelError(f"coordinate {name!r}: got bounds {bounds!r}; give (low, high) with low < high.")
        self.dot, self.ddot = ca.SX.sym(f"d({name})/dt"), ca.SX.sym(f"d2({name})/dt2")

    def __reduce__(self) -> tuple[Any, ...]:
        return Coordinate, (self.name, self.unit, self.description, self.bounds)


class Parameter(ca.SX):
    """A named number; an expression in the equations.

    Parameters
    ----------
    name : str
    default : float
        Value where nothing else is said.
    unit : str
    description : str
    bounds : (float, float)
        Smallest and largest acceptable value, both included.
    """

    def __init__(
        self, name: str, default: float, unit: str = "", description: str = "", bounds: Bounds = (-np.inf, np.inf)
    ):
        super().__init__(ca.SX.sym(name))
        self.name, self.default, self.unit = name, float(default), unit
        self.description, self.bounds = description, (float(bounds[0]), float(bounds[1]))

    def __reduce__(self) -> tuple[Any, ...]:
        return Parameter, (self.name, self.default, self.unit, self.description, self.bounds)
