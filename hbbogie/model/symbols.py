"""Symbols of a model: coordinates with their time derivatives, and parameters."""

from __future__ import annotations

from keyword import iskeyword
from textwrap import shorten
from typing import Any

import casadi as ca
import numpy as np

from hbbogie.errors import ModelError, as_number, told
from hbbogie.units import behind

# Keywords of the functions that take the values of parameters by name: a parameter of such a name could not be given.
_KEYWORDS = (
    "accept_changes amplitude backwards batch chunk coordinate duration equations executor free guess harmonics "
    "initial interval iterations job limit longest maximise method minimise objective options over parameter points "
    "problem progress raise_ rate reach resume retry_failed scheduler secondary seed span stability start starts "
    "step store subject_to system tolerance values workers"
)
RESERVED = frozenset(_KEYWORDS.split())
_ARITHMETIC = (
    "add subtract multiply divide floor_divide remainder power negative positive square matmul less less_equal "
    "greater greater_equal equal not_equal"
)
ARITHMETIC = frozenset(getattr(np, name) for name in _ARITHMETIC.split())
INSTEAD = {  # CasADi's names where NumPy has others
    **{"abs": "fabs", "absolute": "fabs", "maximum": "fmax", "minimum": "fmin", "where": "if_else", "clip": "fmin"},
    **{"arctan": "atan", "arcsin": "asin", "arccos": "acos", "arctan2": "atan2", "amax": "fmax", "amin": "fmin"},
}


class Expression(ca.SX):
    """A symbol, or what arithmetic makes of symbols: a scalar expression that says what cannot be done with it.

    Arithmetic and comparison give an `Expression` again; CasADi's functions give a plain ``casadi.SX``.
    """

    def __bool__(self) -> bool:
        if self.is_constant():
            return bool(ca.SX(self))
        raise ModelError(
            f"{_short(self)}: an expression is neither true nor false while equations are written, so that if, and, "
            "or, max and min cannot take it; write casadi.if_else(condition, then, otherwise), "
            "casadi.logic_and(a, b), casadi.fmax(a, b) or casadi.fmin(a, b)."
        )

    def __float__(self) -> float:
        if self.is_constant():
            return float(ca.SX(self))
        raise ModelError(
            f"{_short(self)}: an expression is no number while equations are written, so that float and the functions "
            "of math cannot take it; write casadi.tanh(x) for math.tanh(x), and the like."
        )

    __int__ = __index__ = __float__

    def __array__(self, dtype: Any = None, **options: Any) -> Any:
        if dtype is not None and np.dtype(dtype) != object:
            return np.array(float(self), dtype=dtype)
        return super().__array__(**options)

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
        if ufunc not in ARITHMETIC:
            raise ModelError(_without_numpy(ufunc.__name__))
        return _expression(super().__array_ufunc__(ufunc, method, *inputs, **options))

    def __array_function__(self, function: Any, types: Any, args: Any, options: Any) -> Any:
        raise ModelError(_without_numpy(function.__name__))

    def __abs__(self) -> Expression:
        return Expression(ca.fabs(self))

    def __copy__(self) -> Expression:
        return self

    def __deepcopy__(self, memo: Any) -> Expression:
        return self  # a symbol is itself wherever it stands


def _close(name: str) -> None:
    """Let an operator of expressions give an expression."""
    operator: Any = getattr(ca.SX, name, None)  # not all releases of CasADi have all

    def method(self: Expression, *other: Any) -> Any:
        result = operator(self, *other)
        if result is NotImplemented and name not in ("__eq__", "__ne__"):
            raise ModelError(
                f"{_short(self)}: got {told(other[0])} on the other side of an operator; give a number, or an "
                "expression of coordinates and parameters (not of casadi.MX, and without quotes)."
            )
        return _expression(result)

    if operator is not None:
        setattr(Expression, name, method)


for _name in ("add", "sub", "mul", "truediv", "floordiv", "mod", "pow", "matmul"):
    _close(f"__{_name}__")
    _close(f"__r{_name}__")
for _name in ("lt", "le", "gt", "ge", "eq", "ne", "neg", "pos"):
    _close(f"__{_name}__")


def _expression(value: Any) -> Any:
    return Expression(value) if type(value) is ca.SX and value.is_scalar() else value


def _short(expression: ca.SX) -> str:
    text = str(expression)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _without_numpy(name: str) -> str:
    other = INSTEAD.get(name, name)
    hint = f"casadi.{other}" if hasattr(ca, other) else "casadi.if_else, casadi.fmax or casadi.tanh"
    return f"numpy.{name} cannot take an expression; write it with CasADi's functions, such as {hint}."


def check_name(kind: str, name: Any) -> None:
    """Raise `ModelError` unless the name of a coordinate or parameter can be given as a keyword."""
    if not isinstance(name, str) or not name.isidentifier() or iskeyword(name):
        raise ModelError(
            f"name of a {kind}: got {told(name)}; give letters, digits and underscores, no digit first and no keyword "
            "of Python, such as 'q1'."
        )
    if kind == "parameter" and name in RESERVED:
        raise ModelError(
            f"name of a parameter: got {name!r}, which is a keyword of functions that take the values of parameters by "
            f"name, such as find_cycles; give another, such as '{name}_0'."
        )


def check_texts(kind: str, name: str, unit: Any, description: Any, group: Any = "") -> None:
    """Raise `ModelError` unless unit, description and group are texts."""
    for what, text in (("unit", unit), ("description", description), ("group", group)):
        if not isinstance(text, str):
            raise ModelError(f"{kind} {name!r}: got {told(text)} as {what}; give a text, such as 'm'.")


def _range(kind: str, name: str, bounds: Any) -> tuple[float, float]:
    try:
        low, high = map(as_number, bounds)
    except (TypeError, ValueError):
        low = high = float("nan")
    if not low < high:
        raise ModelError(f"{kind} {name!r}: got bounds {bounds!r}; give (low, high) with low < high.")
    return low, high


def _described(symbol: Coordinate | Parameter, value: str = "") -> str:
    """Return name, value, unit, description and bounds of a symbol."""
    low, high = symbol.bounds
    limits = f" ({low:g} to {high:g})" if np.isfinite([low, high]).any() else ""
    meaning = f": {shorten(symbol.description, 200, placeholder=' ...')}" if symbol.description else ""
    unit = behind(symbol.unit) if value else f" [{symbol.unit}]" * bool(symbol.unit)
    return f"{symbol.name}{value}{unit}{meaning}{limits}"


class Coordinate(Expression):
    """A coordinate; an expression in the equations, with ``.dot`` and ``.ddot`` as time derivatives.

    Parameters
    ----------
    name : str
        An identifier.
    unit : str
        Unit of the coordinate, such as "m" or "rad".
    description : str
    bounds : (float, float), unit of the coordinate
        Smallest and largest value that has a meaning, both included, such as (0, inf) for a concentration: equilibria
        are looked for within them only, and finite ones say how large the coordinate becomes.
    turn : float, optional, unit of the coordinate
        Of an angle: by how much it may grow with nothing else changed, such as 2 pi (in rad) or 360 (in degrees). The
        equations must be the same then. Solutions that run on, q(t + T) = q(t) + turn, are cycles.
    group : str
        Name of the bodies that it belongs to, such as "front bogie": cycles are told apart by the groups that move.

    Raises
    ------
    ModelError
        When the name is no identifier, the bounds are not (low, high) with low < high, or the turn is no number above
        0.
    """

    def __init__(
        self,
        name: str,
        unit: str = "",
        description: str = "",
        bounds: tuple[float, float] = (-np.inf, np.inf),
        turn: float | None = None,
        group: str = "",
    ):
        check_name("coordinate", name)
        check_texts("coordinate", name, unit, description, group)
        super().__init__(ca.SX.sym(name))
        self.name, self.unit, self.description, self.group = name, unit, description, group
        self.bounds = _range("coordinate", name, bounds)
        self.turn = None if turn is None else as_number(turn)
        if self.turn is not None and not 0 < self.turn < np.inf:
            raise ModelError(
                f"coordinate {name!r}: got {told(turn)} as turn; give a number above 0, such as 2 * pi for an angle in "
                "rad, or leave it out."
            )
        self.dot, self.ddot = (Expression(ca.SX.sym(s)) for s in (f"d({name})/dt", f"d2({name})/dt2"))

    def __repr__(self) -> str:
        return f"Coordinate {_described(self)}"

    def __reduce__(self) -> tuple[Any, ...]:
        return Coordinate, (self.name, self.unit, self.description, self.bounds, self.turn, self.group)


class Parameter(Expression):
    """A named number; an expression in the equations.

    Parameters
    ----------
    name : str
        An identifier, and no keyword of functions that take the values of parameters by name (``tolerance``, ...).
    default : float
        Value where nothing else is said.
    unit : str
    description : str
    bounds : (float, float)
        Smallest and largest acceptable value, both included.

    Raises
    ------
    ModelError
        When the name cannot be used, the default is no number, or the bounds are not (low, high) with low < high.
    """

    def __init__(
        self,
        name: str,
        default: float,
        unit: str = "",
        description: str = "",
        bounds: tuple[float, float] = (-np.inf, np.inf),
    ):
        check_name("parameter", name)
        check_texts("parameter", name, unit, description)
        super().__init__(ca.SX.sym(name))
        self.name, self.default, self.unit, self.description = name, as_number(default), unit, description
        if not np.isfinite(self.default):
            raise ModelError(f"parameter {name!r}: got {told(default)} as default; give a finite number.")
        self.bounds = _range("parameter", name, bounds)

    def __repr__(self) -> str:
        return f"Parameter {_described(self, f' = {self.default:g}')}"

    def __reduce__(self) -> tuple[Any, ...]:
        return Parameter, (self.name, self.default, self.unit, self.description, self.bounds)
