"""Checks of what a system is made from."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from hbbogie.errors import ModelError
from hbbogie.model.elements import Element
from hbbogie.model.symbols import Coordinate, Parameter


def check_names(
    coordinates: Sequence[Coordinate], parameters: Sequence[Parameter], elements: Sequence[Element]
) -> None:
    """Raise `ModelError` unless there are coordinates and all names differ."""
    if not coordinates:
        raise ModelError("a system needs at least one coordinate; got none.")
    for kind, things, constructor in (
        ("coordinates", coordinates, "Coordinate"),
        ("parameters", parameters, "Parameter"),
        ("elements", elements, "Element"),
    ):
        for thing in things:
            if type(thing).__name__ != constructor:
                raise ModelError(f"{kind}: got a {type(thing).__name__}; make it with {constructor}(name, ...).")
    names = [str(thing.name) for group in (coordinates, parameters, elements) for thing in group]
    doubles = sorted({name for name in names if names.count(name) > 1})
    if doubles:
        raise ModelError(f"each name may be used once; got twice or more: {', '.join(doubles)}.")


def check_equations(
    equations: Sequence[Any],
    coordinates: Sequence[Coordinate],
    parameters: Sequence[Parameter],
    elements: Sequence[Element],
) -> ca.SX:
    """Return the equations as a vector; raise `ModelError` when they cannot be meant."""
    n = len(coordinates)
    rows = [ca.SX(e) for e in equations]
    for i, row in enumerate(rows):
        if not row.is_scalar():
            raise ModelError(f"equation {i + 1} has shape {row.shape}; each equation is one scalar expression.")
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
            for s in ca.symvar(ca.vertcat(element.argument, ca.SX(element.law.force(element.argument))))
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
    if any(np.isnan(np.asarray(ca.DM(c))).any() for row in rows for c in _constants(row)):
        raise ModelError("an equation contains a constant that is not a number (NaN); check the numbers used.")
    return ca.vertcat(*rows)


def _constants(row: ca.SX) -> list[float]:
    f = ca.Function("row", ca.symvar(row), [row])
    return [f.instruction_constant(k) for k in range(f.n_instructions()) if f.instruction_id(k) == ca.OP_CONST]


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
