"""Condensation: coordinates that enter linearly are eliminated harmonic by harmonic (eq-condensation)."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from hbbogie.model.parts import Parts
from hbbogie.model.system import System
from hbbogie.results.failure import ConvergenceError

Array = NDArray[np.float64]
LARGEST_BLOCK = 12  # condensed coordinates that hang together: eliminating more at once is written out at length
WORTH = 0.7  # share of a block that may be left in one piece by taking a coordinate out of it


def frequency_scale(system: System, p: Array) -> float:
    """Return a typical frequency: that of the least damped oscillation at rest, or 1 rad/s if there is none."""
    try:
        eigenvalues = np.linalg.eigvals(system.state_matrix(np.zeros(system.n_states), p))
    except ConvergenceError:  # the equations are not smooth at rest
        return 1.0
    pairs = eigenvalues[eigenvalues.imag > 1e-6 * np.abs(eigenvalues).max(initial=0.0)]
    return float(pairs[np.argmax(pairs.real)].imag) if pairs.size else 1.0


def kept_coordinates(parts: Parts, nonlinear: Sequence[int]) -> tuple[int, ...]:
    """Return the coordinates that are not condensed out: the nonlinear ones, and those that part large blocks.

    Linear coordinates that hang together, through no nonlinear one, are eliminated together. Where they are many, as
    the car bodies of a train, the one whose removal leaves the smallest pieces is kept, until all pieces are small.
    """
    links, kept, whole = _links(parts), set(nonlinear), set[int]()
    while True:
        left = [i for i in range(len(links)) if i not in kept]
        large = [b for b in _blocks(links, left) if len(b) > LARGEST_BLOCK and not whole.intersection(b)]
        if not large:
            return tuple(sorted(kept))
        for block in large:
            rests = [max(map(len, _blocks(links, [j for j in block if j != i]))) for i in block]
            best = int(np.argmin(rests))
            if rests[best] <= WORTH * len(block):
                kept.add(block[best])
            else:
                whole.update(block)


def _links(parts: Parts) -> NDArray[np.bool_]:
    """Tell which coordinates and equations a matrix links, either way, shape (n, n)."""
    n = parts.mass.size1_out(0)
    links = np.zeros((n, n), dtype=bool)
    for matrix in (parts.mass, parts.damping, parts.stiffness):
        links |= np.array(ca.DM(matrix.sparsity_out(0), 1.0).full(), dtype=bool)
    return np.asarray(links | links.T)


def _blocks(links: NDArray[np.bool_], some: Sequence[int]) -> list[list[int]]:
    """Return those of some coordinates that hang together."""
    count, label = connected_components(links[np.ix_(some, some)], directed=False)
    return [[some[int(i)] for i in np.flatnonzero(label == k)] for k in range(count)]


def choose_rows(system: System, parts: Parts, C: Sequence[int]) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the equations kept (R) and those that eliminate the linear coordinates (E).

    E are the equations with the same numbers as the coordinates C if they determine C. Otherwise they are the best
    conditioned ones, found by pivoting.
    """
    if not C:
        return tuple(range(system.n)), ()
    p = system.vector()
    kappa = frequency_scale(system, p)
    Z = parts.stiffness(p).full() + 1j * kappa * parts.damping(p).full() - kappa**2 * parts.mass(p).full()
    E = tuple(C)
    block = Z[np.ix_(E, C)]
    if np.linalg.cond(block / np.maximum(np.abs(block).max(axis=1, keepdims=True), 1e-300)) > 1e10:
        _, _, pivots = scipy.linalg.qr(Z[:, C].conj().T, pivoting=True)
        E = tuple(sorted(int(i) for i in pivots[: len(C)]))
    return tuple(i for i in range(system.n) if i not in E), E


def dynamic_stiffness(
    parts: Parts,
    S: Sequence[int],
    C: Sequence[int],
    R: Sequence[int],
    E: Sequence[int],
    force_rows: Sequence[int],
) -> ca.Function:
    """Return (kappa, p) -> (Re Z, Im Z, Re P, Im P), the condensed dynamic stiffness of one harmonic.

    With the inputs y = (x_S, forces in the equations E), the residual of the equations R is Z y, and the condensed
    coordinates are x_C = P y (eq-dynamic-stiffness, eq-condensation).
    """
    kappa, p = ca.SX.sym("kappa"), ca.SX.sym("p", parts.mass.size1_in(0))
    real, imaginary = parts.stiffness(p) - kappa**2 * parts.mass(p), kappa * parts.damping(p)
    R, E, S, C = (list(i) for i in (R, E, S, C))
    Z_re, Z_im = real[R, S], imaginary[R, S]
    if not C:
        return ca.Function("Z", [kappa, p], [Z_re, Z_im, ca.SX(0, len(S)), ca.SX(0, len(S))])
    unit = ca.SX(ca.DM.eye(real.shape[0]))[E, [i for i in force_rows if i in E]]
    top, bottom = ca.horzcat(real[E, S], unit), ca.horzcat(imaginary[E, S], ca.SX(*unit.shape))
    P_re, P_im = ca.SX.zeros(*top.shape), ca.SX.zeros(*top.shape)
    blocks = _blocks(_links(parts), C) if E == C else [C]
    for block in blocks:
        K = [C.index(i) for i in block]
        a, b = real[[E[k] for k in K], block], imaginary[[E[k] for k in K], block]
        used, re, im = _eliminated(a, b, ca.vertcat(top[K, :], bottom[K, :]))
        P_re[K, used], P_im[K, used] = re, im
    padding = ca.SX(len(R), unit.shape[1])
    Z_re = ca.horzcat(Z_re, padding) + real[R, C] @ P_re - imaginary[R, C] @ P_im
    Z_im = ca.horzcat(Z_im, padding) + real[R, C] @ P_im + imaginary[R, C] @ P_re
    return ca.Function("Z", [kappa, p], ca.cse([Z_re, Z_im, P_re, P_im]))


def stiffness_slopes(
    parts: Parts,
    S: Sequence[int],
    C: Sequence[int],
    R: Sequence[int],
    E: Sequence[int],
    force_rows: Sequence[int],
    free: Sequence[int],
) -> ca.Function:
    """Return (kappa, p, Re P, Im P) -> derivatives of vec(Re Z), vec(Im Z) in (kappa, p[free]), one column each.

    With the uncondensed dynamic stiffness W and L = -W_RC W_EC^-1 they are dW_RS + dW_RC P + L (dW_ES + dW_EC P),
    which takes one more elimination, where the derivative of the elimination itself would take one for each column.
    """
    R, E, S, C = (list(i) for i in (R, E, S, C))
    inner, padding = [E.index(i) for i in force_rows if i in E], len(S)
    kappa, p = ca.SX.sym("kappa"), ca.SX.sym("p", parts.mass.size1_in(0))
    P_re, P_im = (ca.SX.sym(name, len(C), padding + len(inner)) for name in ("P_re", "P_im"))
    real, imaginary = parts.stiffness(p) - kappa**2 * parts.mass(p), kappa * parts.damping(p)
    L_re, L_im = ca.SX.zeros(len(R), len(E)), ca.SX.zeros(len(R), len(E))
    for block in (_blocks(_links(parts), C) if E == C else [C]) if C else []:
        K = [C.index(i) for i in block]
        a, b = (w[[E[k] for k in K], block].T for w in (real, imaginary))
        used, re, im = _eliminated(a, b, ca.vertcat(real[R, block].T, imaginary[R, block].T))
        L_re[used, K], L_im[used, K] = re.T, im.T
    slopes_re, slopes_im = [], []
    for variable in (kappa, *(p[i] for i in free)):
        d_re, d_im = (_slope(w, variable) for w in (real, imaginary))
        below_re = ca.horzcat(d_re[E, S], ca.SX(len(E), len(inner))) + d_re[E, C] @ P_re - d_im[E, C] @ P_im
        below_im = ca.horzcat(d_im[E, S], ca.SX(len(E), len(inner))) + d_re[E, C] @ P_im + d_im[E, C] @ P_re
        kept_re = ca.horzcat(d_re[R, S], ca.SX(len(R), len(inner))) + d_re[R, C] @ P_re - d_im[R, C] @ P_im
        kept_im = ca.horzcat(d_im[R, S], ca.SX(len(R), len(inner))) + d_re[R, C] @ P_im + d_im[R, C] @ P_re
        slopes_re.append(ca.vec(kept_re + L_re @ below_re - L_im @ below_im))
        slopes_im.append(ca.vec(kept_im + L_re @ below_im + L_im @ below_re))
    found = [ca.densify(ca.horzcat(*slopes)) for slopes in (slopes_re, slopes_im)]
    return ca.Function("Z_slopes", [kappa, p, P_re, P_im], ca.cse(found))


def _eliminated(a: ca.SX, b: ca.SX, right: ca.SX) -> tuple[list[int], ca.SX, ca.SX]:
    """Return the columns that are not empty of a right-hand side, and -(a + i b)^-1 of them, real and imaginary part.

    The right-hand side has its real part above its imaginary part.
    """
    used = sorted(set(right.sparsity().get_col()))
    if not used:
        return used, ca.SX(a.shape[0], 0), ca.SX(a.shape[0], 0)
    found = ca.solve(ca.blockcat([[a, -b], [b, a]]), -ca.densify(right[:, used]))
    return used, found[: a.shape[0], :], found[a.shape[0] :, :]


def _slope(matrix: ca.SX, variable: ca.SX) -> ca.SX:
    """Return the derivative of each entry of a matrix."""
    return ca.reshape(ca.jacobian(ca.vec(matrix), variable), *matrix.shape)
