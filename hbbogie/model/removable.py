"""Expressions that would be 0/0 at rest, or have no derivative there, written so that they are finite."""

from __future__ import annotations

import casadi as ca

from hbbogie.model.ramps import Scalar
from hbbogie.model.scalars import as_expression


def magnitude(*components: Scalar) -> Scalar:
    """Return the root of the sum of squares, with the derivative 0 where all components are zero.

    ``casadi.sqrt(x**2 + y**2)`` has the derivative 0/0 at rest. With this function an expression of the form
    f(magnitude) * x has its exact slope f(0) there.

    Parameters
    ----------
    *components : scalar
        Of one unit.

    Examples
    --------
    >>> from hbbogie.model import magnitude
    >>> float(magnitude(3.0, 4.0)), float(magnitude(0.0, 0.0))
    (5.0, 0.0)
    """
    _check("magnitude", *components)
    square = sum(c**2 for c in components)
    return ca.if_else(square > 0, ca.sqrt(ca.if_else(square > 0, square, 1)), 0)


def quotient(numerator: Scalar, denominator: Scalar, limit: Scalar) -> Scalar:
    """Return a quotient, and its limit where the denominator is zero.

    Parameters
    ----------
    numerator, denominator : scalar
    limit : scalar, unit of the quotient
        The value that the quotient tends to. Its derivative counts as that of the quotient there.

    Examples
    --------
    >>> import casadi
    >>> from hbbogie.model import quotient
    >>> [round(float(quotient(casadi.sin(x), x, 1.0)), 3) for x in (0.0, 0.5)]
    [1.0, 0.959]
    """
    _check("quotient", numerator, denominator, limit)
    nonzero = denominator != 0
    return ca.if_else(nonzero, numerator / ca.if_else(nonzero, denominator, 1), limit)


def _check(what: str, *given: Scalar) -> None:
    """Raise `ModelError` unless all of them are expressions or numbers."""
    for one in given:
        if not isinstance(one, ca.SX | ca.MX | ca.DM):
            as_expression(what, one)
