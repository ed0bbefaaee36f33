"""Scalars in a model, and the messages about anything else."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import Any

import casadi as ca
import numpy as np

from hbbogie.errors import ModelError, as_number, told


def as_expression(what: str, given: Any) -> ca.SX:
    """Return a scalar expression or a number as an expression; raise `ModelError` for anything else."""
    if isinstance(given, ca.SX | ca.DM):
        if given.is_scalar():
            return ca.SX(given)
        raise ModelError(f"{what}: got an expression of shape {given.shape}; give a scalar one.")
    if isinstance(given, float) or not np.isnan(as_number(given)):
        return ca.SX(float(given))
    if isinstance(given, ca.MX):
        hint = " Symbols of casadi.MX cannot be used, take those of Coordinate and Parameter."
    elif isinstance(given, bool | np.bool_):
        hint = " A condition on a coordinate is written casadi.if_else(condition, then, otherwise)."
    elif isinstance(given, str):
        hint = " Leave out the quotes."
    elif callable(given):
        hint = " Call the function, and give what it returns."
    else:
        hint = ""
    raise ModelError(
        f"{what}: got {told(given)}; give a scalar expression of coordinates and parameters, or a number.{hint}"
    )


def check_scalars(law: Any, not_negative: str = "", above_zero: str = "") -> None:
    """Raise `ModelError` unless all fields of a law are scalars; where they are numbers, of the sign asked for.

    The names of the fields with a sign are separated by blanks.
    """
    signs = {**dict.fromkeys(not_negative.split(), ", 0 or more"), **dict.fromkeys(above_zero.split(), " above 0")}
    for field in fields(law):
        what = f"{type(law).__name__}: {field.name}"
        constant = as_expression(what, getattr(law, field.name))
        if not constant.is_constant():
            continue
        number = float(constant)
        allowed = signs.get(field.name, "")
        if (allowed and number < 0) or (allowed == " above 0" and number == 0) or not np.isfinite(number):
            raise ModelError(f"{what} is {number:g}; give a finite number{allowed}.")


def check_list(what: str, given: Any) -> None:
    """Raise `ModelError` unless a field of a law is a list of scalars."""
    if isinstance(given, str) or not isinstance(given, Sequence | np.ndarray):
        raise ModelError(f"{what}: got {told(given)}; give a list of numbers.")
    for i, value in enumerate(given):
        as_expression(f"{what}, place {i + 1}", value)


def constants(expression: ca.SX) -> list[float]:
    """Return the numbers that an expression contains."""
    f = ca.Function("expression", ca.symvar(expression), [expression])
    return [f.instruction_constant(k) for k in range(f.n_instructions()) if f.instruction_id(k) == ca.OP_CONST]
