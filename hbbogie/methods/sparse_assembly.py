"""Assembly of the harmonic-balance residual of many coordinates, with a sparse Jacobian.

No coordinate is eliminated. The derivative of equation i in the coefficients of coordinate j is then

    sum over d = 0, 1, 2 of  omega^d (linear part of order d + gain of order d) D^d,

where D is the matrix that differentiates coefficients. The linear part is a number, a stiffness, damping or mass. The
gain is a matrix, that of a sampled slope (eq-aft) or of a contact (eq-contact-force), and is zero unless coordinate j
enters equation i nonlinearly. Memory and time thus grow with the number of coordinates and not with its square.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from hbbogie import fourier
from hbbogie.methods.assembly import Assembly
from hbbogie.methods.contact import make_ramp, product_table
from hbbogie.methods.layout import Layout
from hbbogie.methods.sampling import Sampling, sample_moments
from hbbogie.model.parts import Parts
from hbbogie.model.system import System
from hbbogie.once import Once

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Term:
    """How equations i depend on the derivatives of one order of coordinates j.

    Attributes
    ----------
    order : int
    i, j : ndarray of int, shape (pairs,)
    entries : casadi.MX
        Gains, one column each, column by column, or, if ``diagonal``, numbers by which the unit matrix is multiplied.
    diagonal : bool
    """

    order: int
    i: NDArray[np.int_]
    j: NDArray[np.int_]
    entries: ca.MX
    diagonal: bool = False


class SparseAssembly:
    """The functions of one system and one choice of harmonics, for all parameter values, with sparse first derivatives.

    Parameters
    ----------
    layout : Layout
        Of all coordinates, with harmonics above 0.
    system : System

    Attributes
    ----------
    layout : Layout
    R : tuple of int
        Equations whose harmonics above 0 are kept: all.
    residual : casadi.Function, (z, p) -> F
    coefficients : casadi.Function, (z, p) -> shape (2 H + 1, n)
    frequency : casadi.Function, z -> omega
    """

    def __init__(self, layout: Layout, system: System):
        self.layout, self.system, self.n_p = layout, system, len(system.parameters)
        self.R = tuple(range(layout.n))
        self.sampling, self.once = Sampling(layout, self.n_p), Once()
        self.rows = fourier.rows_of(layout.kept)
        self.D = fourier.derivative(np.eye(2 * layout.H + 1))[np.ix_(self.rows, self.rows)]
        self.contacts = layout.parts.contacts
        self.ramp: Any = make_ramp(layout.kept, layout.half) if self.contacts else None
        self.laws = self._laws()
        z, p = ca.MX.sym("z", layout.size), ca.MX.sym("p", self.n_p)
        F = self._balance(z, p, self._moments(z, p))
        self.residual = ca.Function("F", [z, p], [F], ["z", "p"], ["F"])
        kept, omega = self._kept(z)
        places = [int(np.flatnonzero(self.rows == r)[0]) if r in self.rows else -1 for r in range(2 * layout.H + 1)]
        all_rows = ca.vertcat(*(kept[k, :] if k >= 0 else ca.MX.zeros(1, layout.n) for k in places))
        self.coefficients = ca.Function("coefficients", [z, p], [all_rows], ["z", "p"], ["c"])
        self.frequency = ca.Function("omega", [z], [omega])

    # --- residual -------------------------------------------------------------------------------

    def _kept(self, z: ca.MX) -> tuple[ca.MX, ca.MX]:
        """Return the coefficients on the kept rows, shape (rows, n), and omega."""
        X, mean, omega = self.layout.unpack(z)
        return (X if self.layout.odd else ca.vertcat(mean.T, X)), omega

    def _laws(self) -> ca.Function:
        """Return p -> what the contacts are: du/dq, du/dv, u at rest, offset, stiffness; of ramps: slope, threshold."""
        n, p = self.layout.n, ca.SX.sym("p", self.n_p)
        q, v, zero = ca.SX.sym("q", n), ca.SX.sym("v", n), ca.SX.zeros(n)
        u = ca.vertcat(*(e.argument(q, v, p) for e in self.contacts)) if self.contacts else ca.SX(0, 1)
        rest = ca.vertcat(*(e.argument(zero, zero, p) for e in self.contacts)) if self.contacts else ca.SX(0, 1)
        ramps = [e.ramps(p) for e in self.contacts]
        columns = [ca.densify(ca.vertcat(*(r[i] for r in ramps))) for i in range(4)]
        return ca.Function("laws", [p], [ca.jacobian(u, q), ca.jacobian(u, v), ca.densify(rest), *columns])

    @property
    def _owner(self) -> ca.DM:
        """Which contact each ramp belongs to, with the direction of the ramp, shape (ramps, contacts)."""
        owner = [i for i, e in enumerate(self.contacts) for _ in e.directions]
        directions = [float(d) for e in self.contacts for d in e.directions]
        return ca.DM.triplet(list(range(len(owner))), owner, ca.DM(directions), len(owner), len(self.contacts))

    def _arguments(self, z: ca.MX, p: ca.MX) -> ca.MX:
        """Return the coefficients of the contacts' arguments on the kept rows; a preload belongs to the mean."""
        (X, omega), (of_q, of_v, rest, *_) = self._kept(z), self.laws(p)
        u = X @ of_q.T + omega * (ca.sparsify(ca.DM(self.D)) @ X @ of_v.T)
        return u if self.layout.odd else ca.vertcat(u[0, :] + rest.T, u[1:, :])

    def _inputs(self, z: ca.MX, p: ca.MX) -> ca.MX:
        """Return the input of each ramp, w = (-threshold, direction * u), shape (1 + rows, ramps)."""
        _, _, rest, _, _, _, threshold = self.laws(p)
        first = -threshold + (self._owner @ rest if self.layout.odd else 0)
        return ca.vertcat(first.T, self._arguments(z, p) @ self._owner.T)

    def _moments(self, z: ca.MX, p: ca.MX) -> ca.MX:
        """Return the moments of all ramps between their contact times, one column each (eq-contact-moments)."""
        if not self.contacts:
            return ca.MX(0, 0)
        return self.ramp.contacts.map(self._owner.shape[0])(self._inputs(z, p))[0]

    def _ramp_slopes(self, p: ca.MX) -> ca.MX:
        """Return the slope of each ramp with its direction, in the column of its contact."""
        return ca.diag(self.laws(p)[5]) @ self._owner

    def _contact_forces(self, z: ca.MX, p: ca.MX, moments: ca.MX) -> ca.MX:
        """Return the coefficients of the contacts' forces, shape (rows, contacts)."""
        layout, (_, _, rest, offset, stiffness, _, _) = self.layout, self.laws(p)
        w = ca.MX.sym("w", 1 + len(self.rows))
        m = ca.MX.sym("m", moments.shape[0])
        ramp = ca.Function("ramp", [m, w], [self.ramp.gain(m) @ w]).map(moments.shape[1])
        force = self._arguments(z, p) @ ca.diag(stiffness)
        force += ramp(moments, self._inputs(z, p)) @ self._ramp_slopes(p)
        constant = np.zeros(len(self.rows))
        if layout.half:  # over a half period that represents the whole, a constant has harmonics
            constant[1::2] = 4 / (np.pi * np.array(layout.moving))
            return force + ca.DM(constant) @ (offset + stiffness * rest).T
        constant[0] = not layout.odd
        return force + ca.DM(constant) @ offset.T

    def _balance(self, z: ca.MX, p: ca.MX, moments: ca.MX) -> ca.MX:
        """Return F (eq-residual)."""
        layout, parts = self.layout, self.layout.parts
        (X, omega), D = self._kept(z), ca.sparsify(ca.DM(self.D))
        terms = X @ parts.stiffness(p).T + omega * (D @ X @ parts.damping(p).T)
        terms += omega**2 * (D @ (D @ X) @ parts.mass(p).T)
        if layout.parts.remainder_rows:
            count, rows = len(parts.remainder_rows), list(parts.remainder_rows)
            place = ca.DM.triplet(list(range(count)), rows, ca.DM.ones(count), count, layout.n)
            terms += self.sampling.coefficients(z, p) @ place
        if self.contacts:
            terms += self._contact_forces(z, p, moments) @ parts.directions(p).T
        return ca.vec(terms) if layout.odd else ca.vertcat(ca.vec(terms[1:, :]), terms[0, :].T)

    # --- derivatives ----------------------------------------------------------------------------

    def derivatives(self, free: tuple[int, ...]) -> ca.Function:
        """Return (z, p) -> (F, dF/d(z, p[free])), exact and sparse; ``free`` are places in the parameter vector."""
        return self.once(("derivatives", free), lambda: self._build_derivatives(free))

    def hessian(self, free: tuple[int, ...]) -> ca.Function:
        """Return (z, p, multipliers) -> second derivative of multipliers . F with respect to (z, p[free])."""
        return self._dense.hessian(free)

    def hessian_times(self, free: tuple[int, ...]) -> ca.Function:
        """Return (z, p, multipliers, direction) -> that second derivative times a direction, without all of it."""
        return self._dense.hessian_times(free)

    def sensitivity(self) -> ca.Function:
        """Return (z, p, multipliers) -> derivative of multipliers . F with respect to all parameters."""
        return self._dense.sensitivity()

    @property
    def _dense(self) -> Assembly:
        """The same equations with second derivatives, which are not sparse."""
        return self.once("dense", lambda: Assembly(self.layout, self.system))

    def _build_derivatives(self, free: tuple[int, ...]) -> ca.Function:
        z, p = ca.MX.sym("z", self.layout.size), ca.MX.sym("p", self.n_p)
        # the force vanishes at the contact times, so they, and with them the moments, count as constant at first order
        moments = ca.MX.sym("moments", *self._moments(z, p).shape)
        F = self._balance(z, p, moments)
        J = self._motion_jacobian(z, p, moments)
        last = ca.MX(ca.DM.eye(self.layout.size)[:, -1])
        columns = [ca.jtimes(F, z, last), *(ca.jtimes(F, p, ca.MX(ca.DM.eye(self.n_p)[:, i])) for i in free)]
        whole = ca.horzcat(J, *(ca.densify(column) for column in columns))
        given = ca.Function("given", [z, p, moments], [ca.densify(F), whole])
        F, J = given(z, p, self._moments(z, p))
        return ca.Function("dF", [z, p], [F, J], ["z", "p"], ["F", "J"])

    def _motion_jacobian(self, z: ca.MX, p: ca.MX, moments: ca.MX) -> ca.MX:
        """Return the derivative of F in all unknowns but the frequency."""
        parts = self.layout.parts
        terms = [Term(d, *_pairs(m.sparsity_out(0)), m(p).nz[:], True) for d, m in enumerate(_linear(parts))]
        terms += [*self._sampled_terms(z, p), *self._contact_terms(p, moments)]
        values, places, first = [], [], 0
        for term in terms:
            values.append(z[-1] ** term.order * ca.vec(term.entries))
            row, column, source, factor = self._places(term)
            places.append((row, column, first + source, factor))
            first += values[-1].shape[0]
        row, column, source, factor = (np.concatenate(parts) for parts in zip(*places, strict=True))
        there = (row >= 0) & (column >= 0) & (factor != 0)
        m = self.layout.size
        where, to = np.unique(column[there] * m + row[there], return_inverse=True)
        scatter = sparse.csc_matrix((factor[there], (to, source[there])), shape=(len(where), first))
        pattern = ca.Sparsity.triplet(m, m - 1, (where % m).tolist(), (where // m).tolist())
        return ca.MX(pattern, ca.DM(scatter) @ ca.vertcat(*values))

    def _places(self, term: Term) -> tuple[NDArray[np.int_], NDArray[np.int_], NDArray[np.int_], Array]:
        """Return where a term belongs: rows of F, columns of z (-1 for nowhere), places in its entries, and factors."""
        K, power = len(self.rows), np.linalg.matrix_power(self.D, term.order)
        target = np.abs(power).argmax(axis=1)  # a row of the power has one entry at most
        k, c = (np.arange(K), np.arange(K)) if term.diagonal else np.divmod(np.arange(K * K), K)[::-1]
        row, column = self._equation[term.i][:, k], self._unknown[term.j][:, target[c]]
        source = np.repeat(np.arange(len(term.i)), K) if term.diagonal else np.arange(row.size)
        factor = np.broadcast_to(power[c, target[c]], row.shape)
        return row.ravel(), column.ravel(), source, factor.ravel()

    @cached_property
    def _equation(self) -> NDArray[np.int_]:
        """Place in F of each equation's coefficients, shape (n, rows)."""
        n, waves = self.layout.n, self.layout.waves
        moving = np.arange(n * waves).reshape(n, waves)
        return moving if self.layout.odd else np.column_stack([n * waves + np.arange(n), moving])

    @cached_property
    def _unknown(self) -> NDArray[np.int_]:
        """Place in z of each coordinate's coefficients, shape (n, rows); -1 for the one that sets the phase."""
        layout = self.layout
        moving = np.full(layout.n * layout.waves, -1)
        moving[layout.keep] = np.arange(len(layout.keep))
        of_each = moving.reshape(layout.n, layout.waves)
        return of_each if layout.odd else np.column_stack([len(layout.keep) + np.arange(layout.n), of_each])

    def _sampled_terms(self, z: ca.MX, p: ca.MX) -> list[Term]:
        """Return the gains of the slopes of sampled forces (see `Sampling.jacobian`)."""
        layout, parts = self.layout, self.layout.parts
        if not parts.remainder_rows:
            return []
        (states, tau), K = self.sampling.states(z), len(self.rows)
        sx = [ca.SX.sym(s, layout.n) for s in "qva"] + [ca.SX.sym("p", self.n_p), ca.SX.sym("dt")]
        slopes = [ca.jacobian(parts.remainder(*sx), s) for s in sx[:3]]
        every = ca.Function("slopes", sx, [ca.vertcat(*(s.nz[:] for s in slopes))])
        values = every.map("slopes", "serial", len(tau), [3, 4], [])(*states, p, self.sampling.interval(z))
        length = np.pi if layout.half else 2 * np.pi
        table, moments = product_table(layout.H, self.rows, length)[K:, :], sample_moments(layout.H, tau, length)
        ends = np.cumsum([0, *(s.nnz() for s in slopes)]).tolist()
        blocks = ca.horzsplit(table @ (ca.DM(moments) @ values.T), ends)
        return [Term(d, *_pairs(s.sparsity()), b) for d, (s, b) in enumerate(zip(slopes, blocks, strict=True))]

    def _contact_terms(self, p: ca.MX, moments: ca.MX) -> list[Term]:
        """Return the gains of the contacts."""
        if not self.contacts:
            return []
        K, (of_q, of_v, _, _, stiffness, slope, _) = len(self.rows), self.laws(p)
        acting = self.layout.parts.directions(p)
        ramps = ca.diag(slope) @ self._owner**2  # the direction counts twice, in the input and in the force
        gains = self.ramp.table[K:, :] @ moments @ ramps + ca.DM(np.eye(K).ravel()) @ stiffness.T
        rows, of_row = _pairs(acting.sparsity())
        terms = []
        for d, of_motion in enumerate((of_q, of_v)):
            contact, column = _pairs(of_motion.sparsity())
            b, a = (one.ravel() for one in np.nonzero(of_row[:, None] == contact))
            size = acting.nz[b.tolist()] * of_motion.nz[a.tolist()]
            blocks = gains[:, contact[a].tolist()] * ca.repmat(size.T, K * K, 1)
            terms.append(Term(d, rows[b], column[a], blocks))
        return terms


def _linear(parts: Parts) -> tuple[ca.Function, ca.Function, ca.Function]:
    """Return stiffness, damping and mass, functions of p, by growing order of the derivative."""
    return parts.stiffness, parts.damping, parts.mass


def _pairs(pattern: ca.Sparsity) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
    """Return rows and columns of the entries of a matrix."""
    return np.array(pattern.row(), dtype=int), np.array(pattern.get_col(), dtype=int)
