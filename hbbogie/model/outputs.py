"""Outputs: named quantities of a motion, such as a flange force or an acceleration, as expressions of the model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hbbogie.brief import brief
from hbbogie.errors import ModelError, told
from hbbogie.model.ramps import Scalar
from hbbogie.model.scalars import as_expression, constants
from hbbogie.model.symbols import check_texts
from hbbogie.once import Once

Array = NDArray[np.float64]
CHUNK = 64  # instants


@dataclass(frozen=True, eq=False, repr=False)
class Output:
    """A named quantity of a motion: what one wants to know beside the coordinates.

    Parameters
    ----------
    name : str
        In plain words, such as "frame lateral acceleration". Tables, figures and limits call it by this name.
    expression : scalar expression
        Of coordinates, velocities ``x.dot``, accelerations ``x.ddot``, elements (each stands for its force), laws
        called by hand and parameters. Accelerations, and rates of first-order coordinates, are those that follow from
        the equations of motion.
    unit : str
    description : str

    Raises
    ------
    ModelError
        When name, unit or description is no text, or the expression is no scalar one.

    Examples
    --------
    >>> from hbbogie import Coordinate, Parameter, System
    >>> x, k = Coordinate("x", "m"), Parameter("k", 4.0, "1/s2")
    >>> energy = Output("energy", (x.dot**2 + k * x**2) / 2, "m2/s2")
    >>> System("oscillator", [x], [k], [x.ddot + k * x], outputs=[energy]).output_names
    ('energy',)
    """

    name: str
    expression: Scalar
    unit: str = ""
    description: str = ""

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name.strip() or not self.name.isprintable():
            raise ModelError(f"name of an output: got {told(self.name)}; give a text, such as 'flange force'.")
        check_texts("output", self.name, self.unit, self.description)
        expression = as_expression(f"output {self.name!r}", self.expression)
        object.__setattr__(self, "expression", expression)
        if any(np.isnan(c) for c in constants(expression)):
            raise ModelError(
                f"output {self.name!r} contains a constant that is not a number (NaN); check the numbers used, and "
                "write casadi.tanh(x) for math.tanh(x), and the like."
            )

    def __repr__(self) -> str:
        meaning = f": {self.description}" if self.description else ""
        return f"Output {self.name}{f' [{self.unit}]' if self.unit else ''}{meaning}"


@dataclass(frozen=True, eq=False)
class Outputs:
    """The outputs of a system, with one function for all.

    Attributes
    ----------
    names, units, descriptions : tuple of str
    with_forces : casadi.Function, (q, v, a, f, p) -> y, shape (number of outputs,)
        The forces f of the elements are arguments.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    descriptions: tuple[str, ...]
    with_forces: ca.Function

    __repr__ = brief


@dataclass(frozen=True, eq=False)
class Measure:
    """Outputs along a motion.

    Attributes
    ----------
    of : casadi.Function, (q, v, p) -> y, shape (number of outputs,)
    once : Once
        The same for many instants.
    """

    of: ca.Function
    once: Once = field(default_factory=Once, repr=False)

    def __call__(self, q: Array, v: Array, p: Array) -> Array:
        """Return the outputs at N instants.

        Parameters
        ----------
        q, v : ndarray, shape (N, n)
            Coordinates and velocities, each in its unit and per second.
        p : ndarray, shape (number of parameters,)

        Returns
        -------
        ndarray, shape (N, number of outputs), unit of each
        """
        N = len(q)
        size = -(-N // CHUNK) * CHUNK  # few sizes, each built once
        together = self.once(size, lambda: self.of.map(size))
        q, v = (np.concatenate([x, np.repeat(x[-1:], size - N, axis=0)]).T for x in (q, v))
        return np.asarray(together(q, v, p).full().T[:N])


def attach_outputs(
    outputs: Sequence[Output], q: ca.SX, v: ca.SX, a: ca.SX, f: ca.SX, p: ca.SX, where: str
) -> Outputs | None:
    """Return the functions of outputs, None where there are none; raise `ModelError` for symbols not of the system."""
    known = {s.element_hash() for s in ca.symvar(ca.vertcat(q, v, a, f, p))}
    for output in outputs:
        strangers = [s.name() for s in ca.symvar(output.expression) if s.element_hash() not in known]
        if strangers:
            raise ModelError(
                f"{where}: output {output.name!r} contains {', '.join(strangers)}, which is no coordinate, parameter "
                "or element of the system; list it in coordinates=, parameters= or elements=."
            )
    if not outputs:
        return None
    y = ca.vertcat(*(o.expression for o in outputs))
    names, units, descriptions = zip(*((o.name, o.unit, o.description) for o in outputs), strict=True)
    return Outputs(names, units, descriptions, ca.Function("outputs", [q, v, a, f, p], [y], list("qvafp"), ["y"]))
