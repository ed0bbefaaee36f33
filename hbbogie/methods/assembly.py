"""Assembly of the harmonic-balance residual with exact first and second derivatives.

The residual is put together in two stages. What varies with the number of contacts or samples comes
first: the moments of the contact indicators, and the coefficients of sampled forces. Everything else,
among it the dynamic stiffness and the condensation, is one scalar-expanded function of the unknowns,
the parameters and those numbers. Derivatives follow the same two stages, which keeps them exact and
sparse, and far cheaper than differentiating the whole.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hbbogie import fourier
from hbbogie.methods.condensation import choose_rows, dynamic_stiffness
from hbbogie.methods.contact import make_ramp
from hbbogie.methods.layout import Layout
from hbbogie.methods.sampling import Sampling
from hbbogie.system import System

Array = NDArray[np.float64]
ElementForce = Callable[[Any, ca.SX, ca.SX], ca.SX]


class Assembly:
    """The functions of one system and one choice of harmonics, for all parameter values.

    Parameters
    ----------
    layout : Layout
    system : System
    force : callable, optional
        (element, coefficients of its argument, p) -> coefficients of its force, for the elements that the
        layout's parts keep apart; by default their ramps are integrated exactly between the contact times.

    Attributes
    ----------
    layout : Layout
    R : tuple of int
        Equations whose moving harmonics are kept; the others eliminate the condensed coordinates.
    residual : casadi.Function, (z, p) -> F
    coefficients : casadi.Function, (z, p) -> shape (2 H + 1, n)
    frequency : casadi.Function, z -> omega
    """

    def __init__(self, layout: Layout, system: System, force: ElementForce | None = None):
        self.layout, self.n_p, self.force = layout, len(system.parameters), force
        self.sampling = Sampling(layout, self.n_p)
        self.built: dict[Any, Any] = {}
        parts = layout.parts
        contact_rows = set(parts.directions.sparsity_out(0).row())
        self.force_rows = tuple(sorted(set(parts.remainder_rows) | contact_rows))
        self.C = tuple(i for i in range(layout.n) if i not in layout.S)
        self.R, self.E = choose_rows(system, parts, self.C)
        exact = parts.contacts and layout.moving and not force
        self.ramp: Any = make_ramp(layout.kept, layout.odd) if exact else None
        self.ramps = sum(len(e.directions) for e in parts.contacts) if self.ramp else 0
        self._build_stage()
        z, p = self._mx()
        m, c = self._first_stage(z, p)
        # the moments are frozen: the force vanishes at the contact times, so they add nothing at first order
        F = self.stage(z, p, ca.stop_diff(m, 1), c, 0)
        self.residual = ca.Function("F", [z, p], [F], ["z", "p"], ["F"])
        if any(i in self.E for i in self.force_rows):  # condensed coordinates then feel the forces directly
            coefficients = self._decode(z, p, ca.stop_diff(m, 1), c)
        else:
            coefficients = self._decode(z, p, 0, 0)
        self.coefficients = ca.Function("coefficients", [z, p], [coefficients], ["z", "p"], ["c"])
        self.frequency = ca.Function("omega", [z], [layout.unpack(z)[2]])

    def _mx(self) -> tuple[ca.MX, ca.MX]:
        return ca.MX.sym("z", self.layout.size), ca.MX.sym("p", self.n_p)

    # --- first stage: contact moments and sampled forces ----------------------------------------

    def _first_stage(self, z: ca.MX, p: ca.MX) -> tuple[ca.MX, ca.MX]:
        """Return the moments of all ramps, one column each, and the coefficients of the sampled forces."""
        moments = [self.ramp.contacts(w)[0] for w in ca.horzsplit(self.inputs(z, p))] if self.ramp else []
        return ca.horzcat(*moments) if moments else ca.MX(0, 0), self.sampling.coefficients(z, p)

    # --- second stage: everything else, one scalar-expanded function ----------------------------

    def _build_stage(self) -> None:
        layout = self.layout
        z, p = ca.SX.sym("z", layout.size), ca.SX.sym("p", self.n_p)
        rows_kept = len(fourier.rows_of(layout.kept))
        m = ca.SX.sym("m", 2 * (2 * layout.H + 1), self.ramps) if self.ramp else ca.SX(0, 0)
        c = ca.SX.sym("c", rows_kept, len(layout.parts.remainder_rows)) if layout.parts.remainder_rows else ca.SX(0, 0)
        e = ca.SX.sym("e", rows_kept, self.ramps)  # perturbations of the ramps' coefficients, zero in use
        inputs = self._ramp_inputs(z, p)
        self.inputs = ca.Function("inputs", [z, p], [ca.densify(ca.horzcat(*(w for w, _ in inputs)))])
        forces, means = self._forces(z, p, m, c, e, inputs)
        X, mean, omega = layout.unpack(z)
        F, XC = self._balance(X, mean, omega, p, forces, means)
        self.stage = ca.Function("stage", [z, p, m, c, e], [F], list("zpmce"), ["F"])
        at_zero = ca.substitute(self._all_coefficients(X, XC, mean), e, ca.SX.zeros(*e.shape))
        self._decode = ca.Function("decode", [z, p, m, c], [at_zero], list("zpmc"), ["X"])

    def _stage_symbols(self) -> list[ca.SX]:
        """Return symbols for z, p, m, c and a zero for e."""
        names, shapes = self.stage.name_in(), [self.stage.size_in(i) for i in range(5)]
        return [ca.SX.sym(n, *s) for n, s in zip(names[:4], shapes[:4], strict=True)] + [ca.SX(*shapes[4])]

    def _arguments(self, element: Any, z: ca.SX, p: ca.SX) -> ca.SX:
        """Return the coefficients of an element's argument on the kept rows."""
        layout = self.layout
        X, mean, omega = layout.unpack(z)
        zero = ca.SX.zeros(layout.n)
        rest = self._rest(element, p)  # a preload belongs to the mean
        u = [] if layout.odd else [element.argument(mean, zero, p)]
        for k in range(layout.waves):  # a cosine row of the velocity comes from the sine row, and vice versa
            h, (other, sign) = layout.moving[k // 2], ((k - 1, -1) if k % 2 else (k + 1, 1))
            q, v = ca.SX.zeros(layout.n), ca.SX.zeros(layout.n)
            q[list(layout.S)], v[list(layout.S)] = X[k, :].T, X[other, :].T * (sign * h * omega)
            u.append(element.argument(q, v, p) - rest)
        return ca.vertcat(*u)

    def _ramp_inputs(self, z: ca.SX, p: ca.SX) -> list[tuple[ca.SX, ca.SX]]:
        """Return, for each ramp of each contact element, w = (-threshold, direction * u) and its stiffness."""
        inputs = []
        for element in () if self.force else self.layout.parts.contacts:
            u = self._arguments(element, z, p)
            _, _, k, g = element.ramps(p)
            rest = self._rest(element, p) if self.layout.odd else 0  # otherwise the preload is part of the mean
            inputs += [(ca.vertcat(d * rest - g[i], d * u), d * k[i]) for i, d in enumerate(element.directions)]
        return inputs

    def _rest(self, element: Any, p: ca.SX) -> ca.SX:
        """Return an element's argument at rest, its preload."""
        zero = ca.SX.zeros(self.layout.n)
        return element.argument(zero, zero, p)

    def _ramp_force(
        self, element: Any, u: ca.SX, p: ca.SX, m: ca.SX, e: ca.SX, ramps: list[tuple[int, tuple[ca.SX, ca.SX]]]
    ) -> ca.SX:
        """Return the force coefficients of a contact element: its straight line and its ramps, with their places."""
        layout = self.layout
        offset, stiffness, _, _ = element.ramps(p)
        force = stiffness * u
        if layout.odd:  # over the half period that stands for the whole, a constant is not free of harmonics
            for k, h in enumerate(layout.moving):
                force[2 * k + 1] += (offset + stiffness * self._rest(element, p)) * 4 / (np.pi * h)
        else:
            force[0] += offset
        for place, (w, k) in ramps:
            if self.ramp:
                force += k * (ca.mtimes(self.ramp.gain(m[:, place]), w) + e[:, place])
            else:
                force += k * ca.fmax(w[0] + w[1], 0)
        return force

    def _forces(
        self, z: ca.SX, p: ca.SX, m: ca.SX, c: ca.SX, e: ca.SX, inputs: list[tuple[ca.SX, ca.SX]]
    ) -> tuple[dict[int, ca.SX], list[ca.SX]]:
        """Return the force coefficients of the moving harmonics per equation, and the mean force of each."""
        layout, parts = self.layout, self.layout.parts
        total = {i: ca.SX.zeros(len(fourier.rows_of(layout.kept))) for i in range(layout.n)}
        for k, i in enumerate(parts.remainder_rows):
            total[i] += c[:, k]
        B, place = parts.directions(p), 0
        for column, element in enumerate(parts.contacts):
            u = self._arguments(element, z, p)
            if self.force:
                force = self.force(element, u, p)
            else:
                end = place + len(element.directions)
                ramps = list(enumerate(inputs))[place:end]
                force, place = self._ramp_force(element, u, p, m, e, ramps), end
            for i in set(B[:, column].sparsity().row()):
                total[i] += B[i, column] * force
        first = 0 if layout.odd else 1
        return {i: total[i][first:] for i in self.force_rows}, [total[i][0] if first else ca.SX(0) for i in total]

    def _balance(
        self, X: ca.SX, mean: ca.SX, omega: ca.SX, p: ca.SX, forces: dict[int, ca.SX], means: list[ca.SX]
    ) -> tuple[ca.SX, list[ca.SX]]:
        """Return F and the coefficients of the condensed coordinates (eq-residual, eq-condensation)."""
        layout = self.layout
        rows: list[list[ca.SX]] = [[] for _ in self.R]
        XC: list[list[ca.SX]] = [[] for _ in self.C]
        stiff = dynamic_stiffness(layout.parts, layout.S, self.C, self.R, self.E, self.force_rows)
        for k, h in enumerate(layout.moving):
            Z_re, Z_im, P_re, P_im = stiff(h * omega, p)
            pair = [X[2 * k : 2 * k + 2, j] for j in range(len(layout.S))]
            pair += [forces[i][2 * k : 2 * k + 2] for i in self.force_rows if i in self.E]
            for out, re, im in ((rows, Z_re, Z_im), (XC, P_re, P_im)):
                x, y = ca.vertcat(*(v[0] for v in pair)), ca.vertcat(*(v[1] for v in pair))
                # a coefficient pair (c, s) stands for the complex amplitude c - i s
                cosine, sine = re @ x + im @ y, re @ y - im @ x
                for i, target in enumerate(out):
                    target += [cosine[i], sine[i]]
        F = [ca.vertcat(*r) + forces.get(i, 0) for r, i in zip(rows, self.R, strict=True)] if layout.moving else []
        if layout.means:
            F.append(layout.parts.stiffness(p) @ mean + ca.vertcat(*means))
        return ca.vertcat(*F), [ca.vertcat(*x) for x in XC]

    def _all_coefficients(self, X: ca.SX, XC: list[ca.SX], mean: ca.SX) -> ca.SX:
        layout = self.layout
        out = ca.SX.zeros(2 * layout.H + 1, layout.n)
        out[0, :] = mean.T
        rows = list(map(int, fourier.rows_of(layout.moving)))
        if rows:
            for j, i in enumerate(layout.S):
                out[rows, i] = X[:, j]
            for i, x in zip(self.C, XC, strict=True):
                out[rows, i] = x
        return out

    # --- derivatives ----------------------------------------------------------------------------

    def derivatives(self, free: tuple[int, ...]) -> ca.Function:
        """Return (z, p) -> (F, dF/d(z, p[free])), exact; ``free`` are places in the parameter vector."""
        return self._once(("derivatives", free), lambda: self._build_derivatives(free))

    def hessian(self, free: tuple[int, ...]) -> ca.Function:
        """Return (z, p, multipliers) -> second derivative of multipliers . F with respect to (z, p[free])."""
        return self._once(("hessian", free), lambda: self._build_hessian(free))

    def sensitivity(self) -> ca.Function:
        """Return (z, p, multipliers) -> derivative of multipliers . F with respect to all parameters."""
        return self._once("sensitivity", self._build_sensitivity)

    def _once(self, key: Any, build: Callable[[], ca.Function]) -> ca.Function:
        if key not in self.built:
            self.built[key] = build()
        return self.built[key]

    def _build_derivatives(self, free: tuple[int, ...]) -> ca.Function:
        sx = self._stage_symbols()
        F = self.stage(*sx)
        y = ca.vertcat(sx[0], *(sx[1][i] for i in free))
        first = ca.Function("stage_jacobian", sx[:4], [F, ca.jacobian(F, y), ca.jacobian(F, ca.vec(sx[3]))])
        z, p = self._mx()
        m, c = self._first_stage(z, p)
        F, J, J_c = first(z, p, m, c)
        if self.layout.parts.remainder_rows:
            J = J + ca.mtimes(J_c, self.sampling.jacobian(z, p, free))
        return ca.Function("dF", [z, p], [F, J], ["z", "p"], ["F", "J"])

    def _build_sensitivity(self) -> ca.Function:
        sx, lam = self._stage_symbols(), ca.SX.sym("multipliers", self.layout.size)
        L = ca.dot(lam, self.stage(*sx))
        slopes = [ca.densify(ca.gradient(L, sx[1])), ca.densify(ca.gradient(L, ca.vec(sx[3])))]
        first = ca.Function("stage_slopes", [*sx[:4], lam], slopes)  # one sweep backwards, not a Jacobian
        z, p = self._mx()
        multipliers = ca.MX.sym("multipliers", self.layout.size)
        m, c = self._first_stage(z, p)
        L_p, L_c = first(z, p, m, c, multipliers)
        if self.layout.parts.remainder_rows:
            everything = tuple(range(self.n_p))
            L_p = L_p + ca.mtimes(L_c.T, self.sampling.jacobian(z, p, everything)[:, self.layout.size :]).T
        return ca.Function("sensitivity", [z, p, multipliers], [L_p], ["z", "p", "multipliers"], ["L_p"])

    def _build_hessian(self, free: tuple[int, ...]) -> ca.Function:
        sx = self._stage_symbols()
        sx[4] = ca.SX.sym("e", *self.stage.size_in(4))
        lam = ca.SX.sym("multipliers", self.layout.size)
        y = ca.vertcat(sx[0], *(sx[1][i] for i in free))
        L = ca.dot(lam, self.stage(*sx))
        L_e, L_c = (ca.gradient(L, ca.vec(sx[i])) for i in (4, 3))
        pulls = ca.Function("pulls", [*sx[:2], lam], [ca.reshape(L_e, *self.stage.size_in(4)), L_c])
        # the moments vary with w only at second order (eq-contact-hessian): a quadratic form Q for each ramp
        n_w = self.inputs.size1_out(0)
        Q = ca.SX.sym("Q", n_w, n_w * self.ramps)
        forms = [Q[:, i * n_w : (i + 1) * n_w] for i in range(self.ramps)]
        inputs = ca.horzsplit(self.inputs(*sx[:2])) if self.ramps else []
        curved = L + sum((0.5 * ca.bilin(W, w, w) for W, w in zip(forms, inputs, strict=True)), ca.SX(0))
        at_zero = [
            ca.substitute(f, sx[4], ca.SX.zeros(*sx[4].shape)) for f in (ca.hessian(curved, y)[0], ca.jacobian(L_c, y))
        ]
        second = ca.Function("stage_hessian", [*sx[:4], lam, Q], at_zero)
        z, p = self._mx()
        multipliers = ca.MX.sym("multipliers", self.layout.size)
        m, c = self._first_stage(z, p)
        pull_e, pull_c = pulls(z, p, multipliers)
        forms = []
        for i, w in enumerate(ca.horzsplit(self.inputs(z, p)) if self.ramp else []):
            _, times, weights = self.ramp.contacts(w)
            forms.append(self.ramp.curvature(times, weights, pull_e[:, i]))
        H, H_c = second(z, p, m, c, multipliers, ca.horzcat(*forms) if forms else ca.MX(n_w, 0))
        if self.layout.parts.remainder_rows:
            cross = ca.mtimes(H_c.T, self.sampling.jacobian(z, p, free))
            H = H + cross + cross.T + self.sampling.hessian(free)(z, p, pull_c)
        return ca.Function("hessian", [z, p, multipliers], [H], ["z", "p", "multipliers"], ["H"])
