"""Exact Fourier coefficients of piecewise-linear forces, integrated between their contact times.

A ramp ``k max(s(tau), 0)`` with ``s`` a trigonometric polynomial is the product of ``k s`` and the contact indicator,
which is 1 where s > 0. The Fourier coefficients of the indicator follow in closed form from the contact times, the
roots of s; those of the force are then a Toeplitz-plus-Hankel matrix of the indicator's coefficients times those of s
(theory page, eq-contact-moments and eq-contact-force). There is no sampling error. Since the force vanishes at the
contact times, the first derivative is that same matrix.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hbbogie import fourier

NEWTON_STEPS = 6
BLOCK = 8  # cells of the phase grid that are looked at together; most have no contact
GRAZING_SLOPE = 1e-7  # smallest |s'| relative to the largest coefficient: at grazing the second derivative is infinite


@dataclass(frozen=True, eq=False)
class Ramp:
    """Functions that integrate ``max(s, 0)`` exactly, for s with the given harmonics.

    ``s`` is stored as w, shape (1 + rows,): a constant, then the coefficients on `rows`. Over half a period the result
    is the contribution of one ramp of an odd pair.

    Attributes
    ----------
    rows : ndarray of int
        Coefficient rows kept.
    contacts : casadi.Function, w -> (moments, contact times [rad], 1 / abs(s') or 0 where there is no contact)
    table : casadi.DM
        Maps the moments to vec(G): the coefficients of the ramp are G w.
    length : float, rad
        Length of the interval of integration, 2 pi or pi.
    """

    rows: NDArray[np.int_]
    contacts: ca.Function
    table: ca.DM
    length: float
    harmonics: tuple[int, ...]

    def gain(self, moments: ca.SX) -> ca.SX:
        """Return G, shape (rows, 1 + rows): the coefficients of max(s, 0) are G w (eq-contact-force)."""
        return ca.reshape(ca.mtimes(self.table, moments), len(self.rows), 1 + len(self.rows))

    def curvature(self, times: ca.MX, weights: ca.MX, multipliers: ca.MX) -> ca.MX:
        """Return the matrix of second derivatives of multipliers . G w, shape (1 + rows,) squared.

        It results from the movement of the contact times with w (eq-contact-hessian).
        """
        basis = _symbolic_basis(self.harmonics, times)
        projection = basis[:, 1:] * (2 / self.length)
        if self.harmonics[0] == 0:
            projection = ca.horzcat(projection[:, 0] / 2, projection[:, 1:])
        weight = weights * ca.mtimes(projection, multipliers)
        return ca.mtimes(basis.T, ca.repmat(weight, 1, basis.shape[1]) * basis)


def make_ramp(harmonics: tuple[int, ...], half: bool) -> Ramp:
    """Build the functions for a set of harmonics (including 0 unless only odd ones are kept).

    Parameters
    ----------
    harmonics : tuple of int
        The harmonics kept, in increasing order.
    half : bool
        Whether to integrate over half a period, which is enough for pairs of ramps of odd-harmonic signals.
    """
    H = harmonics[-1]
    cells = max(32, 4 * H) if half else max(64, 8 * H)  # at least four for each wave of the highest harmonic
    cells += -cells % BLOCK
    length = np.pi if half else 2 * np.pi
    rows = fourier.rows_of(harmonics)
    w = ca.MX.sym("w", 1 + len(rows))
    nodes = np.linspace(0, length, cells + 1)
    E0, E1 = (_basis(H, rows, nodes, d) for d in (0, 1))
    s, ds = ca.mtimes(E0, w), ca.mtimes(E1, w)
    ends = [s[:-1].T, s[1:].T, ds[:-1].T, ds[1:].T]
    kinds = _kinds(ends, length / cells)
    cell = _cell(harmonics, rows, length / cells)
    block = _block(cell, len(rows), 2 * (2 * H + 1))
    along = [kinds, w, ca.DM(nodes[:-1].reshape(1, -1)), *ends]
    moments, times, weights = block.map("blocks", "serial", cells // BLOCK, [1], [0])(*along)
    limits = _antiderivatives(H, np.array([0.0, length]))
    moments = moments + ca.if_else(s[-1] > 0, 1, 0) * limits[:, 1] - ca.if_else(s[0] > 0, 1, 0) * limits[:, 0]
    contacts = ca.Function("contacts", [w], [moments, ca.vec(times), ca.vec(weights)])
    return Ramp(rows, contacts, product_table(H, rows, length), length, harmonics)


def _block(cell: ca.Function, rows: int, moments: int) -> ca.Function:
    """Return what ``BLOCK`` cells in a row contribute together; nearly nothing is done where all are idle."""
    arguments = [ca.MX.sym("kinds", 1, BLOCK), ca.MX.sym("w", 1 + rows)]
    arguments += [ca.MX.sym(name, 1, BLOCK) for name in ("lo", "s_lo", "s_hi", "ds_lo", "ds_hi")]
    none = [ca.MX.zeros(moments), ca.MX.zeros(2, BLOCK), ca.MX.zeros(2, BLOCK)]
    idle = ca.Function("idle", arguments, none)
    work = ca.Function("work", arguments, cell.map("cells", "serial", BLOCK, [1], [0])(*arguments))
    chosen = ca.Function.if_else("chosen", work, idle)
    return ca.Function("block", arguments, chosen(ca.mmax(arguments[0]) > 0, *arguments))


def _basis(H: int, rows: np.ndarray, tau: np.ndarray, derivative: int) -> ca.DM:
    """Return the matrix, shape (len(tau), 1 + rows), that evaluates w at the phases tau."""
    constant = np.full((len(tau), 1), float(derivative == 0))
    return ca.DM(np.hstack([constant, fourier.synthesis(H, tau, derivative)[:, rows]]))


def _symbolic_basis(harmonics: tuple[int, ...], tau: ca.MX) -> ca.MX:
    columns = [ca.MX.ones(tau.shape[0])]
    for h in harmonics:
        columns += [ca.MX.ones(tau.shape[0])] if h == 0 else [ca.cos(h * tau), ca.sin(h * tau)]
    return ca.horzcat(*columns)


def _antiderivatives(H: int, tau: np.ndarray) -> np.ndarray:
    """Return the antiderivatives of cos(k tau), then sin(k tau), k = 0 ... 2 H, shape (2 (2 H + 1), len(tau))."""
    k = np.arange(1, 2 * H + 1)[:, None]
    zero = np.zeros((1, len(tau)))
    return np.vstack([tau[None, :], np.sin(k * tau) / k, zero, -np.cos(k * tau) / k])


def product_table(H: int, rows: np.ndarray, length: float) -> ca.DM:
    """Return the constant matrix that maps the moments of a function g to vec(G) (eq-contact-force).

    The moments are the integrals of g(tau) cos(k tau), then of g(tau) sin(k tau), k = 0 ... 2 H, over an
    interval of the given length; G w are the coefficients on `rows` of g times the signal w (its constant,
    then its coefficients on `rows`).
    """
    K = 2 * H + 1
    harmonic = [(0, "c")] + [((r + 1) // 2, "c" if r % 2 or r == 0 else "s") for r in rows]
    entries: dict[tuple[int, int], float] = {}

    def add(place: int, kind: str, k: int, value: float) -> None:
        if kind == "s" and k < 0:
            value, k = -value, -k
        moment = abs(k) + (K if kind == "s" else 0)
        entries[place, moment] = entries.get((place, moment), 0.0) + value

    for j, (m, mk) in enumerate(harmonic):
        for i, (h, hk) in enumerate(harmonic[1:]):
            place, scale = j * len(rows) + i, 0.5 * (1 if h == 0 else 2) / length
            if mk == hk:  # cos cos, sin sin
                add(place, "c", m - h, scale)
                add(place, "c", m + h, scale if mk == "c" else -scale)
            else:  # the harmonic of the sine comes first in the difference
                add(place, "s", m + h, scale)
                add(place, "s", m - h if mk == "s" else h - m, scale)
    places, moments = zip(*entries, strict=True)
    shape = (1 + len(rows)) * len(rows), 2 * K
    return ca.DM.triplet(list(places), list(moments), ca.DM(list(entries.values())), *shape)


def _kinds(ends: list[ca.MX], width: float) -> ca.MX:
    """Return the kind of each cell: 0 no contact, 1 one crossing, 2 an extremum that may touch or cross zero."""
    s_lo, s_hi, ds_lo, ds_hi = ends
    near = ca.fmin(ca.fabs(s_lo), ca.fabs(s_hi)) < 2 * width * ca.fmax(ca.fabs(ds_lo), ca.fabs(ds_hi))
    turns = ca.logic_and(ds_lo * ds_hi < 0, near)
    return ca.if_else(turns, 2, ca.if_else((s_lo > 0) != (s_hi > 0), 1, 0))


def _cell(harmonics: tuple[int, ...], rows: np.ndarray, width: float) -> ca.Function:
    """Return the contribution of one cell of the phase grid, of a given kind, to the moments, and its contact times.

    Cells without a contact cost nothing. Cells with an extremum inside are divided there, so that contacts shorter than
    a cell (grazing) are found as well.
    """
    H = harmonics[-1]
    w = ca.SX.sym("w", 1 + len(rows))
    lo, s_lo, s_hi, ds_lo, ds_hi = (ca.SX.sym(n) for n in ("lo", "s_lo", "s_hi", "ds_lo", "ds_hi"))
    arguments = [w, lo, s_lo, s_hi, ds_lo, ds_hi]
    hi = lo + width
    n_moments = 2 * (2 * H + 1)
    idle = ca.Function("idle", arguments, [ca.SX.zeros(n_moments), ca.SX.zeros(2), ca.SX.zeros(2)])

    evaluate, contact = _evaluation(harmonics), _contact(harmonics)
    m, tau, weight = contact(w, lo, hi, s_lo, s_hi, lo + width * s_lo / (s_lo - s_hi))
    crossing = ca.Function("crossing", arguments, [m, ca.vertcat(tau, lo), ca.vertcat(weight, 0)])

    top = lo + width * ds_lo / (ds_lo - ds_hi)
    for _ in range(NEWTON_STEPS):
        _, d1, d2 = evaluate(w, top)
        top = ca.fmin(ca.fmax(top - d1 / d2, lo), hi)
    s_top, _, d2 = evaluate(w, top)
    reach = ca.sqrt(2 * ca.fabs(s_top / d2))
    m1, tau1, weight1 = contact(w, lo, top, s_lo, s_top, ca.fmax(top - reach, lo))
    m2, tau2, weight2 = contact(w, top, hi, s_top, s_hi, ca.fmin(top + reach, hi))
    extremum = ca.Function("extremum", arguments, [m1 + m2, ca.vertcat(tau1, tau2), ca.vertcat(weight1, weight2)])

    return ca.Function.conditional("cell", [idle, crossing], extremum)


def _evaluation(harmonics: tuple[int, ...]) -> ca.Function:
    """Return (w, tau) -> s, s', s'', by rotation from harmonic to harmonic, with only one sine and one cosine."""
    w, tau = ca.SX.sym("w", 1 + len(fourier.rows_of(harmonics))), ca.SX.sym("tau")
    s, d1, d2 = w[0], ca.SX(0), ca.SX(0)
    cosines, sines = _rotations(harmonics[-1], tau)
    place = 1
    for h in harmonics:
        if h == 0:
            s, place = s + w[place], place + 1
            continue
        c = w[place] * cosines[h] + w[place + 1] * sines[h]
        q = w[place + 1] * cosines[h] - w[place] * sines[h]
        s, d1, d2, place = s + c, d1 + h * q, d2 - h * h * c, place + 2
    return ca.Function("evaluate", [w, tau], [s, d1, d2])


def _rotations(K: int, tau: ca.SX) -> tuple[list[ca.SX], list[ca.SX]]:
    c1, s1 = ca.cos(tau), ca.sin(tau)
    cosines, sines = [ca.SX(1), c1], [ca.SX(0), s1]
    for _ in range(2, K + 1):
        c, s = cosines[-1], sines[-1]
        cosines.append(c * c1 - s * s1)
        sines.append(s * c1 + c * s1)
    return cosines, sines


def _contact(harmonics: tuple[int, ...]) -> ca.Function:
    """Return (w, lo, hi, s_lo, s_hi, start) -> moments, time and 1/|s'| of the one crossing in [lo, hi].

    They are zero if there is none.
    """
    w, evaluate = ca.SX.sym("w", 1 + len(fourier.rows_of(harmonics))), _evaluation(harmonics)
    lo, hi, s_lo, s_hi, start = (ca.SX.sym(n) for n in ("lo", "hi", "s_lo", "s_hi", "start"))
    crosses = (s_lo > 0) != (s_hi > 0)
    rising = s_hi > 0
    tau, a, b = start, lo, hi
    for _ in range(NEWTON_STEPS):  # Newton's method, safeguarded by bisection
        s, d1, _ = evaluate(w, tau)
        before = (s > 0) != rising
        a, b = ca.if_else(before, tau, a), ca.if_else(before, b, tau)
        step = tau - s / d1
        tau = ca.if_else(ca.logic_and(step >= a, step <= b), step, (a + b) / 2)
    _, d1, _ = evaluate(w, tau)
    H = harmonics[-1]
    cosines, sines = _rotations(2 * H, tau)
    k = range(1, 2 * H + 1)
    anti = ca.vertcat(tau, *(sines[i] / i for i in k), 0, *(-cosines[i] / i for i in k))
    sign = ca.if_else(crosses, ca.if_else(rising, -1, 1), 0)  # entering contact: minus the antiderivative
    weight = ca.if_else(crosses, 1 / ca.fmax(ca.fabs(d1), GRAZING_SLOPE * ca.norm_inf(w)), 0)
    found = [ca.if_else(crosses, sign * anti, 0), ca.if_else(crosses, tau, lo), weight]
    return ca.Function("contact", [w, lo, hi, s_lo, s_hi, start], found)
