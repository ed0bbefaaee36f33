"""What expressions divide by, and take roots and logarithms of."""

from __future__ import annotations

import casadi as ca

WHAT = {
    ca.OP_DIV: "divides by",
    ca.OP_INV: "divides by",
    ca.OP_SQRT: "has the root of",
    ca.OP_LOG: "has the logarithm of",
}
POWERS = {ca.OP_POW, ca.OP_CONSTPOW}


def divisions(expression: ca.SX) -> list[tuple[str, ca.SX]]:
    """Return what an expression divides by, and takes roots, logarithms and broken powers of."""
    symbols = ca.symvar(expression)
    if not symbols:
        return []
    f = ca.Function("expression", symbols, [expression])
    work: dict[int, ca.SX] = {}
    found: dict[tuple[str, str], ca.SX] = {}
    for k in range(f.n_instructions()):
        op, into, of = f.instruction_id(k), f.instruction_output(k), f.instruction_input(k)
        if op == ca.OP_OUTPUT:
            continue
        if op == ca.OP_CONST:
            work[into[0]] = ca.SX(f.instruction_constant(k))
            continue
        if op == ca.OP_INPUT:
            work[into[0]] = symbols[of[0]]
            continue
        terms = [work[i] for i in of]
        what, guilty = WHAT.get(op, ""), terms[-1]
        if op in POWERS and not (terms[1].is_constant() and float(terms[1]) >= 0 and float(terms[1]).is_integer()):
            what, guilty = "has a broken or negative power of", terms[0]
        if what and not guilty.is_constant():
            found.setdefault((what, str(guilty)), guilty)
        work[into[0]] = ca.SX.unary(op, *terms) if len(terms) == 1 else ca.SX.binary(op, *terms)
    return [(what, guilty) for (what, _), guilty in found.items()]
