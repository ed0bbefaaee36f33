"""CasADi functions as Fortran statements."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from hbbogie.errors import ModelError

# of the operations of a scalar-expanded function: what they are in Fortran, with a and b for the arguments
OPERATIONS = {
    ca.OP_ASSIGN: "{a}",
    ca.OP_ADD: "{a} + {b}",
    ca.OP_SUB: "{a} - {b}",
    ca.OP_MUL: "{a} * {b}",
    ca.OP_DIV: "{a} / {b}",
    ca.OP_NEG: "-{a}",
    ca.OP_INV: "1d0 / {a}",
    ca.OP_SQ: "{a}**2",
    ca.OP_TWICE: "2d0 * {a}",
    ca.OP_POW: "{a}**{b}",
    ca.OP_CONSTPOW: "{a}**{b}",
    ca.OP_FMIN: "min({a}, {b})",
    ca.OP_FMAX: "max({a}, {b})",
    ca.OP_FABS: "abs({a})",
    ca.OP_SIGN: "merge(sign(1d0, {a}), 0d0, {a} /= 0d0)",
    ca.OP_LT: "merge(1d0, 0d0, {a} < {b})",
    ca.OP_LE: "merge(1d0, 0d0, {a} <= {b})",
    ca.OP_EQ: "merge(1d0, 0d0, {a} == {b})",
    ca.OP_NE: "merge(1d0, 0d0, {a} /= {b})",
    ca.OP_NOT: "merge(1d0, 0d0, {a} == 0d0)",
    ca.OP_AND: "merge(1d0, 0d0, {a} /= 0d0 .and. {b} /= 0d0)",
    ca.OP_OR: "merge(1d0, 0d0, {a} /= 0d0 .or. {b} /= 0d0)",
    ca.OP_ATAN2: "atan2({a}, {b})",
    ca.OP_FLOOR: "aint({a}) - merge(1d0, 0d0, {a} < aint({a}))",
    ca.OP_CEIL: "aint({a}) + merge(1d0, 0d0, {a} > aint({a}))",
    ca.OP_FMOD: "mod({a}, {b})",
    ca.OP_COPYSIGN: "sign({a}, {b})",
    ca.OP_HYPOT: "hypot({a}, {b})",
    ca.OP_LOG1P: "log(1d0 + {a})",
    ca.OP_EXPM1: "exp({a}) - 1d0",
}
CIRCULAR = [arc + name + h for name in ("sin", "cos", "tan") for arc in ("", "a") for h in ("", "h")]
FUNCTIONS = ("exp", "log", "sqrt", "erf", *CIRCULAR)
OPERATIONS |= {getattr(ca, f"OP_{name.upper()}"): f"{name}({{a}})" for name in FUNCTIONS}


def number(value: float) -> str:
    """Return a number as a Fortran constant of double precision; an infinite one as the largest there is."""
    if np.isnan(value):
        raise ModelError("the equations contain a constant that is not a number; mend them before the export.")
    if np.isinf(value):
        return "huge(1d0)" if value > 0 else "(-huge(1d0))"
    mantissa, _, exponent = repr(float(value)).partition("e")
    text = f"{mantissa}d{int(exponent or 0)}"
    return f"({text})" if value < 0 else text


def statements(
    function: ca.Function, inputs: Sequence[Sequence[str]], outputs: Sequence[Sequence[Sequence[str]]]
) -> tuple[list[str], int]:
    """Return the Fortran statements of a function, and how many places they need in a work array ``W``.

    Parameters
    ----------
    function : casadi.Function
        Of scalar operations only, as made from SX or by ``expand``.
    inputs : sequence of sequence of str
        What each element of each input is called.
    outputs : sequence of sequence of sequence of str
        What each element of each output is called: row by row.

    Raises
    ------
    ModelError
        For an operation that Fortran does not have.

    Examples
    --------
    >>> import casadi as ca
    >>> x = ca.SX.sym("x")
    >>> lines, places = statements(ca.Function("f", [x], [3 * ca.sin(x)]), [["U(1)"]], [[["F(1)"]]])
    >>> for line in lines:
    ...     print(line)
    W(1) = 3.0d0
    W(2) = U(1)
    W(2) = sin(W(2))
    W(1) = W(1) * W(2)
    F(1) = W(1)
    """
    places = [list(zip(*function.sparsity_out(i).get_triplet(), strict=True)) for i in range(function.n_out())]
    lines: list[str] = []
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        given, found = function.instruction_input(k), function.instruction_output(k)
        if operation == ca.OP_OUTPUT:
            row, column = places[found[0]][found[1]]
            lines.append(f"{outputs[found[0]][row][column]} = W({given[0] + 1})")
            continue
        target = f"W({found[0] + 1})"
        arguments = dict(zip("ab", (f"W({i + 1})" for i in given), strict=False))
        if operation == ca.OP_CONST:
            lines.append(f"{target} = {number(function.instruction_constant(k))}")
        elif operation == ca.OP_INPUT:
            lines.append(f"{target} = {inputs[given[0]][given[1]]}")
        elif operation == ca.OP_IF_ELSE_ZERO:  # what is not chosen may be infinite
            lines += [f"if ({arguments['a']} /= 0d0) then", f"  {target} = {arguments['b']}"]
            lines += ["else", f"  {target} = 0d0", "end if"]
        elif operation in OPERATIONS:
            lines.append(f"{target} = {OPERATIONS[operation].format(**arguments)}")
        else:
            raise ModelError(
                f"the equations contain an operation (number {operation} of CasADi) that has no counterpart in "
                "Fortran; write it by arithmetic, powers, exponentials and trigonometric functions."
            )
    return lines, function.sz_w()
