"""Assembly of the harmonic-balance residual with exact first and second derivatives.

The residual is assembled in two stages. The first stage contains what depends on the number of contacts or samples: the
Fourier coefficients of the ramps and of the sampled forces. Everything else, including the dynamic stiffness and the
condensation, is one scalar-expanded function of the unknowns, the parameters and those coefficients, and is linear in
the latter. Derivatives follow the same two stages. This keeps them exact and sparse, and makes them far cheaper than
differentiating the whole.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hbbogie import fourier
from hbbogie.methods.condensation import choose_rows, dynamic_stiffness, stiffness_slopes
from hbbogie.methods.contact import make_ramp
from hbbogie.methods.layout import Layout
from hbbogie.methods.sampling import Sampling
from hbbogie.methods.second_derivatives import hessian, hessian_times, sensitivity
from hbbogie.model.system import System
from hbbogie.once import Once

Array = NDArray[np.float64]
ElementForce = Callable[[Any, ca.SX, ca.SX], ca.SX]
Gains = list[tuple[ca.MX, ca.MX, ca.MX, ca.MX]]  # of each ramp


class Assembly:
    """The functions of one system and one choice of harmonics, for all parameter values.

    Parameters
    ----------
    layout : Layout
    system : System
    force : callable, optional
        (element, coefficients of its argument, p) -> coefficients of its force, for the elements that the layout's
        parts keep separate. By default, their ramps are integrated exactly between the contact times.

    Attributes
    ----------
    layout : Layout
    R : tuple of int
        Equations whose harmonics above 0 are kept; the others eliminate the condensed coordinates.
    residual : casadi.Function, (z, p) -> F
    coefficients : casadi.Function, (z, p) -> shape (2 H + 1, n)
    frequency : casadi.Function, z -> omega
    """

    def __init__(self, layout: Layout, system: System, force: ElementForce | None = None):
        self.layout, self.n_p, self.force = layout, len(system.parameters), force
        self.sampling = Sampling(layout, self.n_p)
        self.once = Once()
        parts = layout.parts
        contact_rows = set(parts.directions.sparsity_out(0).row())
        self.force_rows = tuple(sorted(set(parts.remainder_rows) | contact_rows))
        self.C = tuple(i for i in range(layout.n) if i not in layout.S)
        self.R, self.E = choose_rows(system, parts, self.C)
        exact = parts.contacts and layout.moving and not force
        self.ramp: Any = make_ramp(layout.kept, layout.half) if exact else None
        self.ramps = sum(len(e.directions) for e in parts.contacts) if self.ramp else 0
        self._build_stage()
        z, p = self._mx()
        c = self.first_stage(z, p, self.gains(z, p))
        self.residual = ca.Function("F", [z, p], [self.stage(z, p, c)], ["z", "p"], ["F"])
        if not any(i in self.E for i in self.force_rows):  # the forces do not act directly on condensed coordinates
            c = ca.MX.zeros(*c.shape)
        self.coefficients = ca.Function("coefficients", [z, p], [self._decode(z, p, c)], ["z", "p"], ["c"])
        self.frequency = ca.Function("omega", [z], [layout.unpack(z)[2]])

    def _mx(self) -> tuple[ca.MX, ca.MX]:
        return ca.MX.sym("z", self.layout.size), ca.MX.sym("p", self.n_p)

    # --- first stage: ramps between their contact times, and sampled forces ---------------------

    def gains(self, z: ca.MX, p: ca.MX) -> Gains:
        """Return the input w of each ramp, its gain G (the coefficients are G w), its contact times and weights."""
        found = []
        for w in ca.horzsplit(self.inputs(z, p)) if self.ramp else []:
            moments, times, weights = self.ramp.contacts(w)
            # held constant: the force vanishes at the contact times, so they do not matter at first order
            found.append((w, self.ramp.gain(ca.stop_diff(moments, 1)), times, weights))
        return found

    def first_stage(self, z: ca.MX, p: ca.MX, gains: Gains) -> ca.MX:
        """Return the coefficients of all ramps and then of the sampled forces, one column each."""
        ramps = [ca.mtimes(G, w) for w, G, _, _ in gains]
        return ca.horzcat(*ramps, self.sampling.coefficients(z, p))

    def first_stage_jacobian(
        self, z: ca.MX, p: ca.MX, gains: Gains, free: tuple[int, ...]
    ) -> tuple[ca.MX, list[ca.MX]]:
        """Return the derivatives of vec(`first_stage`) and of each ramp's input with respect to (z, p[free])."""
        W = ca.vertsplit(self._input_slopes(free)(z, p), self.inputs.size1_out(0)) if gains else []
        blocks = [ca.mtimes(G, slope) for (_, G, _, _), slope in zip(gains, W, strict=True)]
        if self.layout.parts.remainder_rows:
            blocks.append(self.sampling.jacobian(z, p, free))
        return ca.vertcat(*blocks) if blocks else ca.MX(0, self.layout.size + len(free)), W

    def _input_slopes(self, free: tuple[int, ...]) -> ca.Function:
        """Return (z, p) -> derivative of all ramps' inputs, one below the other, with respect to (z, p[free])."""
        z, p, _ = self.stage_symbols()
        y = ca.vertcat(z, *(p[i] for i in free))
        return ca.Function("input_slopes", [z, p], [ca.jacobian(ca.vec(self.inputs(z, p)), y)])

    # --- second stage: everything else, one scalar-expanded function ----------------------------

    def _build_stage(self) -> None:
        layout = self.layout
        z, p = ca.SX.sym("z", layout.size), ca.SX.sym("p", self.n_p)
        rows_kept = len(fourier.rows_of(layout.kept))
        c = ca.SX.sym("c", rows_kept, self.ramps + len(layout.parts.remainder_rows))
        inputs = self._ramp_inputs(z, p)
        self.inputs = ca.Function("inputs", [z, p], [ca.densify(ca.horzcat(*(w for w, _ in inputs)))])
        forces, means = self._forces(z, p, c, inputs)
        X, mean, omega = layout.unpack(z)
        self._stiff = dynamic_stiffness(layout.parts, layout.S, self.C, self.R, self.E, self.force_rows)
        Z = [ca.SX.sym("Z", w) for _ in layout.moving for w in map(self._stiff.sparsity_out, range(4))]
        F, XC = self._balance(X, mean, omega, p, forces, means, Z)
        whole = self._all_coefficients(X, XC, mean)
        self._of_stiffness = ca.Function("balance", [z, p, c, *Z], [F, whole])
        F, whole = self._of_stiffness(z, p, c, *self._stiffness(z, p))
        self.stage = ca.Function("stage", [z, p, c], [F], list("zpc"), ["F"])
        self._decode = ca.Function("decode", [z, p, c], [whole], list("zpc"), ["X"])

    def _stiffness(self, z: ca.SX, p: ca.SX) -> list[ca.SX]:
        """Return the dynamic stiffness of each harmonic, Re Z, Im Z, Re P and Im P one after the other."""
        omega = self.layout.unpack(z)[2]
        return [w for h in self.layout.moving for w in self._stiff(h * omega, p)]

    def stage_symbols(self) -> list[ca.SX]:
        """Return symbols for z, p and c."""
        return [ca.SX.sym(name, *self.stage.size_in(i)) for i, name in enumerate(self.stage.name_in())]

    def _arguments(self, element: Any, z: ca.SX, p: ca.SX) -> ca.SX:
        """Return the coefficients of an element's argument on the kept rows."""
        layout = self.layout
        X, mean, omega = layout.unpack(z)
        rest = self._rest(element, p)  # a preload belongs to the mean
        u = [] if layout.odd else [element.argument(mean, omega * layout.drift, p)]
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
        self, element: Any, u: ca.SX, p: ca.SX, c: ca.SX, ramps: list[tuple[int, tuple[ca.SX, ca.SX]]]
    ) -> ca.SX:
        """Return the force coefficients of a contact element from its straight line and its ramps, at their places."""
        layout = self.layout
        offset, stiffness, _, _ = element.ramps(p)
        force = stiffness * u
        if layout.half:  # over a half period that represents the whole, a constant has harmonics
            for k, h in enumerate(layout.moving):
                force[2 * k + 1] += (offset + stiffness * self._rest(element, p)) * 4 / (np.pi * h)
        elif not layout.odd:
            force[0] += offset
        for place, (w, k) in ramps:
            force += k * (c[:, place] if self.ramp else ca.fmax(w[0] + w[1], 0))
        return force

    def _forces(
        self, z: ca.SX, p: ca.SX, c: ca.SX, inputs: list[tuple[ca.SX, ca.SX]]
    ) -> tuple[dict[int, ca.SX], list[ca.SX]]:
        """Return the force coefficients of the harmonics above 0 for each equation, and the mean force in each."""
        layout, parts = self.layout, self.layout.parts
        total = {i: ca.SX.zeros(len(fourier.rows_of(layout.kept))) for i in range(layout.n)}
        for k, i in enumerate(parts.remainder_rows):
            total[i] += c[:, self.ramps + k]
        B, place = parts.directions(p), 0
        for column, element in enumerate(parts.contacts):
            u = self._arguments(element, z, p)
            if self.force:
                force = self.force(element, u, p)
            else:
                end = place + len(element.directions)
                ramps = list(enumerate(inputs))[place:end]
                force, place = self._ramp_force(element, u, p, c, ramps), end
            for i in set(B[:, column].sparsity().row()):
                total[i] += B[i, column] * force
        first = 0 if layout.odd else 1
        return {i: total[i][first:] for i in self.force_rows}, [total[i][0] if first else ca.SX(0) for i in total]

    def _balance(
        self,
        X: ca.SX,
        mean: ca.SX,
        omega: ca.SX,
        p: ca.SX,
        forces: dict[int, ca.SX],
        means: list[ca.SX],
        Z: list[ca.SX],
    ) -> tuple[ca.SX, list[ca.SX]]:
        """Return F and the coefficients of the condensed coordinates (eq-residual, eq-condensation)."""
        layout = self.layout
        rows: list[list[ca.SX]] = [[] for _ in self.R]
        XC: list[list[ca.SX]] = [[] for _ in self.C]
        for k in range(len(layout.moving)):
            Z_re, Z_im, P_re, P_im = Z[4 * k : 4 * k + 4]
            pair = [X[2 * k : 2 * k + 2, j] for j in range(len(layout.S))]
            pair += [forces[i][2 * k : 2 * k + 2] for i in self.force_rows if i in self.E]
            for out, re, im in ((rows, Z_re, Z_im), (XC, P_re, P_im)):
                x, y = ca.vertcat(*(v[0] for v in pair)), ca.vertcat(*(v[1] for v in pair))
                # a coefficient pair (c, s) represents the complex amplitude c - i s
                cosine, sine = re @ x + im @ y, re @ y - im @ x
                for i, target in enumerate(out):
                    target += [cosine[i], sine[i]]
        F = [ca.vertcat(*r) + forces.get(i, 0) for r, i in zip(rows, self.R, strict=True)] if layout.moving else []
        if not layout.odd:
            linear = layout.parts.stiffness(p) @ mean
            if layout.advance:
                linear += layout.parts.damping(p) @ ca.DM(layout.drift) * omega
            F.append(linear + ca.vertcat(*means))
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
        return self.once(("derivatives", free), lambda: self._build_derivatives(free))

    def hessian(self, free: tuple[int, ...]) -> ca.Function:
        """Return (z, p, multipliers) -> second derivative of multipliers . F with respect to (z, p[free])."""
        return self.once(("hessian", free), lambda: hessian(self, free))

    def hessian_times(self, free: tuple[int, ...]) -> ca.Function:
        """Return (z, p, multipliers, direction) -> that second derivative times a direction, without all of it."""
        return self.once(("hessian_times", free), lambda: hessian_times(self, free))

    def sensitivity(self) -> ca.Function:
        """Return (z, p, multipliers) -> derivative of multipliers . F with respect to all parameters."""
        return self.once("sensitivity", lambda: sensitivity(self))

    def _build_derivatives(self, free: tuple[int, ...]) -> ca.Function:
        first = self._stage_jacobian(free)
        z, p = self._mx()
        gains = self.gains(z, p)
        F, J, J_c = first(z, p, self.first_stage(z, p, gains))
        J = J + ca.mtimes(J_c, self.first_stage_jacobian(z, p, gains, free)[0])
        return ca.Function("dF", [z, p], [ca.densify(F), ca.densify(J)], ["z", "p"], ["F", "J"])

    def _stage_jacobian(self, free: tuple[int, ...]) -> ca.Function:
        """Return (z, p, c) -> F and its derivatives in (z, p[free]) and in vec(c)."""
        z, p, c = sx = self.stage_symbols()
        values = self._stiffness(z, p)
        Z = [ca.SX.sym("Z", w.sparsity()) for w in values]
        F, y = self._of_stiffness(*sx, *Z)[0], ca.vertcat(z, *(p[i] for i in free))
        J, J_c = ca.jacobian(F, y), ca.jacobian(F, ca.vec(c))
        if Z:  # what the stiffnesses add to the columns of omega and the parameters
            slopes = stiffness_slopes(self.layout.parts, self.layout.S, self.C, self.R, self.E, self.force_rows, free)
            entries, rates = [], []
            for k, h in enumerate(self.layout.moving):
                d_Z = slopes(h * z[-1], p, *values[4 * k + 2 : 4 * k + 4])
                for w, d in zip(Z[4 * k : 4 * k + 2], d_Z, strict=True):
                    entries += w.nonzeros()
                    rates.append(ca.horzcat(h * d[:, 0], d[:, 1:])[w.sparsity().find(), :])
            added = ca.jacobian(F, ca.vertcat(*entries)) @ ca.vertcat(*rates)
            J += ca.horzcat(ca.SX(J.shape[0], self.layout.size - 1), added)
        return ca.Function("stage_jacobian", sx, ca.substitute([F, J, J_c], Z, values))
