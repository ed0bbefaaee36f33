"""Checks of the parts from which a system is made."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from math import isfinite
from typing import Any, TypeVar

import casadi as ca
import numpy as np

from hbbogie.errors import ModelError, as_number, told
from hbbogie.model.elements import Element, force_of
from hbbogie.model.outputs import Output
from hbbogie.model.scalars import as_expression, constants
from hbbogie.model.symbols import Coordinate, Parameter
from hbbogie.units import behind

T = TypeVar("T", Coordinate, Parameter, Element, Output)


def check_names(
    name: str,
    coordinates: Sequence[Coordinate],
    parameters: Sequence[Parameter],
    elements: Sequence[Element],
    description: str = "",
    outputs: Sequence[Output] = (),
) -> tuple[tuple[Coordinate, ...], tuple[Parameter, ...], tuple[Element, ...], tuple[Output, ...]]:
    """Return them all as tuples; raise `ModelError` unless they are what they should be and all names differ."""
    for what, text in (("name", name), ("description", description)):
        if not isinstance(text, str) or (what == "name" and not text):
            raise ModelError(f"{what} of a system: got {told(text)}; give a text, such as 'bogie'.")
    groups = (
        _all("coordinates", coordinates, Coordinate),
        _all("parameters", parameters, Parameter),
        _all("elements", elements, Element),
        _all("outputs", outputs, Output),
    )
    if not groups[0]:
        raise ModelError("a system needs at least one coordinate; got none.")
    names = [str(thing.name) for group in groups for thing in group]
    doubles = sorted({name for name in names if names.count(name) > 1})
    if doubles:
        raise ModelError(f"each name may be used once; got twice or more: {', '.join(doubles)}.")
    return groups


def _all(kind: str, things: Any, constructor: type[T]) -> tuple[T, ...]:
    example = f"give a list of them, such as [{constructor.__name__}(name, ...)]"
    for thing in listed(kind, things, example):
        if not isinstance(thing, constructor):
            raise ModelError(f"{kind}: got {told(thing)} in the list; make it with {constructor.__name__}(name, ...).")
    return tuple(things)


def listed(kind: str, things: Any, instead: str) -> tuple[Any, ...]:
    """Return things as a tuple; raise `ModelError` where they are no list."""
    if isinstance(things, ca.SX | ca.MX | ca.DM | str | bytes | Mapping) or not isinstance(things, Iterable):
        raise ModelError(f"{kind}: got {told(things)}; {instead}.")
    return tuple(things)


def check_equations(
    equations: Sequence[Any],
    coordinates: Sequence[Coordinate],
    parameters: Sequence[Parameter],
    elements: Sequence[Element],
) -> ca.SX:
    """Return the equations as a vector; raise `ModelError` when they cannot be meant."""
    n = len(coordinates)
    given = listed("equations", equations, "give a list of expressions, one for each coordinate, such as [x.ddot + x]")
    rows = [as_expression(f"equation {i + 1}", e) for i, e in enumerate(given)]
    for i, row in enumerate(rows):
        if any(row.is_op(op) for op in (ca.OP_EQ, ca.OP_NE, ca.OP_LT, ca.OP_LE)):
            raise ModelError(
                f"equation {i + 1} ({row}) is a comparison; write the equation as what must be zero, its left side "
                "minus its right side."
            )
    if len(rows) != n:
        raise ModelError(f"got {len(rows)} equations for {n} coordinates; give one equation for each coordinate.")
    motion = [s for c in coordinates for s in (c, c.dot, c.ddot)]
    known = {s.element_hash() for s in [*motion, *parameters, *elements]}
    moving = {s.element_hash() for s in [*motion, *elements]}
    for i, row in enumerate(rows):
        symbols = ca.symvar(row)
        strangers = [s.name() for s in symbols if s.element_hash() not in known]
        if strangers:
            raise ModelError(
                f"equation {i + 1} contains {', '.join(strangers)}, which is no coordinate, parameter or element of "
                "the system; list it in coordinates=, parameters= or elements=."
            )
        if not any(s.element_hash() in moving for s in symbols):
            raise ModelError(f"equation {i + 1} ({row}) contains no coordinate; every equation must contain one.")
    for element in elements:
        strangers = [
            s.name()
            for s in ca.symvar(ca.vertcat(element.argument, force_of(element, element.argument)))
            if s.element_hash() not in known
        ]
        if strangers:
            raise ModelError(
                f"element {element.name!r} contains {', '.join(strangers)}, which is no coordinate or parameter of the "
                "system; list it in coordinates= or parameters=."
            )
    used = {s.element_hash() for row in rows for s in ca.symvar(row)}
    for element in elements:
        if element.element_hash() not in used:
            raise ModelError(f"element {element.name!r} stands in no equation; add its force to one.")
    if any(np.isnan(np.asarray(ca.DM(c))).any() for row in rows for c in constants(row)):
        raise ModelError(
            "an equation contains a constant that is not a number (NaN); check the numbers used, and write "
            "casadi.tanh(x) for math.tanh(x), and the like: the functions of math make NaN of an expression."
        )
    return ca.vertcat(*rows)


def orders(residual: ca.Function, coordinates: Sequence[Coordinate]) -> tuple[bool, ...]:
    """Return for each coordinate whether its second derivative occurs (else its first must)."""
    rates, accelerations = (set(residual.jac_sparsity(0, i).get_col()) for i in (1, 2))
    for i, c in enumerate(coordinates):
        if i not in rates and i not in accelerations:
            raise ModelError(
                f"neither velocity nor acceleration of coordinate {c.name!r} occurs in the equations; eliminate it "
                "by hand, or give it mass or damping."
            )
    return tuple(i in accelerations for i in range(len(coordinates)))


def checked_value(parameter: Parameter, value: Any) -> float:
    """Return the value of a parameter; raise `ModelError` unless it is a finite number within the bounds."""
    (low, high), number = parameter.bounds, as_number(value)
    if not (isfinite(number) and low <= number <= high):
        got = f"{number:g}" if number == number else told(value)
        unit = behind(parameter.unit)
        raise ModelError(
            f"parameter {parameter.name!r} ({parameter.description or 'no description'}): got {got}{unit}; "
            f"allowed is a finite number from {low:g} to {high:g}{unit}."
        )
    return number
