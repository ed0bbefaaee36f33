"""Floquet multipliers of exact cycles: eigenvalues of the product of the phases' exponentials.

If a law jumps, the product contains the jump (saltation) matrix. Continuous laws have none.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hbbogie.exact.closing import Closing, Linearised
from hbbogie.results import Stability
from hbbogie.stability.verdicts import judge

Array = NDArray[np.float64]

TRUSTED = 1e-6  # largest error of the trivial multiplier, and of the logarithm of the determinant
MARGIN = 1e-6  # smallest normal speed, relative to that on the other side, at which a motion counts as passing


def maps(closing: Closing, at: Linearised) -> tuple[Array, NDArray[np.bool_]]:
    """Return the map of disturbances of each cycle, and whether the motion passes wherever the field jumps.

    Returns
    -------
    ndarray, shape (B, n, n)
        In scaled states: the monodromy matrix, or G = -Phi(T/2) of an odd cycle over half a period.
    ndarray of bool, shape (B,)
    """
    n, S, sequence = closing.n, closing.sequence.S, closing.sequence
    passes = np.ones(len(at.nodes), dtype=bool)
    if not any(closing.model.surfaces[k].jumps for k in sequence.events):
        return sequence.sigma * at.moved[S, :, :n, :n], passes
    A = at.A[:, sequence.of]
    product = np.broadcast_to(np.eye(closing.model.N), at.E[-1][:, 0].shape)
    for i, k in enumerate(sequence.events):
        product = at.E[-1][:, i] @ product
        if closing.model.surfaces[k].jumps:
            x, row = at.nodes[:, i + 1, :, None], at.rows[:, sequence.of[i], k, None]
            before = A[:, i] @ x
            after = A[:, i + 1] @ x if i + 1 < S else sequence.sigma * (A[:, 0] @ at.nodes[:, 0, :, None])
            after[:, -1] = 0.0
            u, v = (row @ before)[:, 0, 0], (row @ after)[:, 0, 0]
            passes &= (u * v > 0) & (np.minimum(np.abs(u), np.abs(v)) > MARGIN * np.maximum(np.abs(u), np.abs(v)))
            product = product + (after - before) @ (row @ product) / np.where(u == 0, 1.0, u)[:, None, None]
    return sequence.sigma * product[:, :n, :n], passes


def stabilities(closing: Closing, y: Array, at: Linearised) -> list[Stability]:
    """Return multipliers and verdicts of each cycle.

    Liouville's formula serves as a check. It compares the determinant of the map with the traces of the state matrices,
    which are constant between switchings.
    """
    n, S, sequence = closing.n, closing.sequence.S, closing.sequence
    matrices, passes = maps(closing, at)
    traces = np.trace(at.A, axis1=2, axis2=3)[:, sequence.of]
    parts = 2 if sequence.sigma < 0 else 1
    found = []
    for b in range(len(y)):
        if not passes[b]:
            none = np.full(n, np.nan, dtype=complex)
            reason = "the motion does not pass where an element jumps: it sticks, or slides along the surface."
            found.append(Stability("unknown", none, float("nan"), 0, reason))
            continue
        log_det = parts * float(np.linalg.slogdet(at.E[-1][b, :, :n, :n])[1].sum())
        trace = parts * float(traces[b] @ y[b, n : n + S])
        found.append(judge(matrices[b], parts, log_det, trace, TRUSTED))
    return found
