"""Sampled forces: alternating between frequency and time, with exact derivatives (eq-aft)."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hbbogie import fourier
from hbbogie.methods.contact import product_table
from hbbogie.methods.layout import Layout

Array = NDArray[np.float64]


class Sampling:
    """The Fourier coefficients of the remainder of a system, and their derivatives.

    Parameters
    ----------
    layout : Layout
    n_p : int
        Number of parameters.
    """

    def __init__(self, layout: Layout, n_p: int):
        self.layout, self.n_p = layout, n_p

    def states(self, z: ca.MX) -> tuple[list[ca.MX], Array]:
        """Return position, velocity and acceleration at the samples, each (n, samples used), and the phases."""
        layout = self.layout
        X, mean, omega = layout.unpack(z)
        N = layout.samples if layout.moving else 1
        tau = fourier.phases(N)[: N // 2 if layout.half else N]  # an odd force repeats itself with the opposite sign
        states = []
        for d in range(3):
            x = ca.MX.zeros(layout.n, len(tau))
            if layout.moving:
                E = ca.DM(fourier.synthesis(layout.H, tau, d)[:, fourier.rows_of(layout.moving)])
                x[list(layout.S), :] = (ca.mtimes(E, X) * omega**d).T
            x = x + ca.repmat(mean, 1, len(tau)) if d == 0 else x
            if layout.advance and d < 2:  # eq-running
                x = x + (ca.DM(np.outer(layout.drift, tau)) if d == 0 else omega * ca.DM(layout.drift))
            states.append(x)
        return states, tau

    def interval(self, z: ca.MX) -> ca.MX:
        """Return the time between samples [s], which is also the time over which jumps are spread."""
        return 2 * np.pi / (self.layout.samples * self.layout.unpack(z)[2]) if self.layout.moving else ca.MX(0)

    def projection(self, count: int) -> ca.DM:
        """Return the matrix that maps ``count`` samples to the coefficients kept."""
        rows = fourier.rows_of(self.layout.kept)
        if not self.layout.moving:
            return ca.DM([[1.0]])
        A = fourier.analysis(self.layout.H, self.layout.samples)[rows][:, :count]
        return ca.DM(A * (self.layout.samples / count))

    def coefficients(self, z: ca.MX, p: ca.MX) -> ca.MX:
        """Alternate between frequency and time: evaluate at equidistant samples and project back (eq-aft)."""
        rows = self.layout.parts.remainder_rows
        if not rows:
            return ca.MX(0, 0)
        states, tau = self.states(z)
        f = self.layout.parts.remainder.map("forces", "serial", len(tau), [3, 4], [])(*states, p, self.interval(z))
        return ca.mtimes(self.projection(len(tau)), f[list(rows), :].T)

    def jacobian(self, z: ca.MX, p: ca.MX, free: Sequence[int]) -> ca.MX:
        """Return the derivative of vec(`coefficients`) with respect to (z, p[free]).

        The coefficients of a slope times a signal are a Toeplitz-plus-Hankel matrix of the slope's moments times the
        coefficients of the signal. This also holds exactly for sums over samples. Jumps are straight lines over the
        time between samples, which depends on the frequency.
        """
        layout, parts = self.layout, self.layout.parts
        rows, (X, _, omega), (states, tau) = parts.remainder_rows, layout.unpack(z), self.states(z)
        sx = [ca.SX.sym(s, layout.n) for s in "qva"] + [ca.SX.sym("p", self.n_p), ca.SX.sym("dt")]
        r, dt = parts.remainder(*sx)[list(rows)], self.interval(z)
        slopes = [ca.jacobian(r, s)[:, list(layout.S)] for s in sx[:3]]
        places = [(d, *place) for d in range(3) for place in zip(*slopes[d].sparsity().get_triplet(), strict=True)]
        entries = ca.vertcat(*(slopes[d][i, j] for d, i, j in places))
        of_p, of_dt = ca.vec(ca.jacobian(r, sx[3])[:, list(free)]), ca.jacobian(r, sx[4])
        f = ca.Function("slopes", sx, [entries, ca.densify(of_p), of_dt])
        values, by_p, by_dt = f.map("slopes", "serial", len(tau), [3, 4], [])(*states, p, dt)
        kept, length = fourier.rows_of(layout.kept), np.pi if layout.half else 2 * np.pi
        table = product_table(layout.H, kept, length)
        used = sorted(set(table.sparsity().get_triplet()[1]))  # over half a period every other moment
        moments = ca.DM(sample_moments(layout.H, tau, length)[used])
        products = ca.horzsplit(ca.mtimes(table[:, used], ca.mtimes(moments, values.T))) if places else []
        G_of = {place: ca.reshape(G, len(kept), 1 + len(kept)) for place, G in zip(places, products, strict=True)}
        D = fourier.derivative(np.eye(2 * layout.H + 1))[
            np.ix_(fourier.rows_of(layout.moving), fourier.rows_of(layout.moving))
        ]
        first = 1 if layout.odd else 2  # where the moving columns of G begin
        blocks = []
        for i in range(len(rows)):
            columns, d_omega, d_mean = [], ca.MX.zeros(len(kept)), ca.MX(len(kept), layout.n)
            for j in range(len(layout.S)):
                block = ca.MX(len(kept), layout.waves)
                for d in range(3):
                    if (G := G_of.get((d, i, j))) is None:
                        continue
                    if d == 0 and layout.means:
                        d_mean[:, layout.S[j]] = G[:, 0]
                    if d == 1 and layout.advance:
                        d_omega += G[:, 0] * layout.drift[layout.S[j]]
                    if layout.moving:
                        wave = ca.mtimes(G[:, first:], ca.sparsify(ca.DM(np.linalg.matrix_power(D, d))))
                        block += wave * omega**d
                        d_omega += ca.mtimes(wave, X[:, j]) * (d * omega ** (d - 1)) if d else 0
                columns.append(block)
            moving = ca.horzcat(*columns)[:, list(map(int, layout.keep))] if layout.moving else ca.MX(len(kept), 0)
            A = self.projection(len(tau))
            if layout.moving and of_dt.sparsity().has_nz(i, 0):
                d_omega -= ca.mtimes(A, by_dt[i, :].T) * dt / omega
            d_p = [ca.mtimes(A, by_p[k * len(rows) + i, :].T) for k in range(len(free))]
            blocks.append(
                ca.horzcat(moving, d_mean[:, list(layout.means)], *([d_omega] if layout.moving else []), *d_p)
            )
        return ca.vertcat(*blocks)

    def hessian(self, free: tuple[int, ...]) -> ca.Function:
        """Return (z, p, pull) -> second derivative of pull . vec(`coefficients`) with respect to (z, p[free])."""
        size = self.layout.size
        y, p = ca.MX.sym("y", size + len(free)), ca.MX.sym("p", self.n_p)
        shifted = ca.MX(p)
        for k, i in enumerate(free):
            shifted[i] += y[size + k]
        c = ca.vec(self.coefficients(y[:size], shifted))
        pull = ca.MX.sym("pull", c.shape[0])
        f = ca.Function("sampled_hessian", [y, p, pull], [ca.hessian(ca.dot(pull, c), y)[0]])
        z = ca.MX.sym("z", size)
        return ca.Function("sampled_hessian", [z, p, pull], [f(ca.vertcat(z, ca.MX.zeros(len(free))), p, pull)])

    def hessian_times(self, free: tuple[int, ...]) -> ca.Function:
        """Return (z, p, pull, direction) -> that second derivative times a direction of (z, p[free])."""
        size = self.layout.size
        y, p, direction = ca.MX.sym("y", size + len(free)), ca.MX.sym("p", self.n_p), ca.MX.sym("d", size + len(free))
        shifted = ca.MX(p)
        for k, i in enumerate(free):
            shifted[i] += y[size + k]
        c = ca.vec(self.coefficients(y[:size], shifted))
        pull = ca.MX.sym("pull", c.shape[0])
        along = ca.jtimes(ca.gradient(ca.dot(pull, c), y), y, direction)
        f = ca.Function("sampled", [y, p, pull, direction], [ca.densify(along)])
        z = ca.MX.sym("z", size)
        at = f(ca.vertcat(z, ca.MX.zeros(len(free))), p, pull, direction)
        return ca.Function("sampled_hessian_times", [z, p, pull, direction], [at])


def sample_moments(H: int, tau: Array, length: float) -> Array:
    """Return the matrix that maps samples at ``tau`` to integrals with cos(k tau), sin(k tau), k = 0 ... 2 H."""
    k = np.arange(2 * H + 1)[:, None]
    return np.vstack([np.cos(k * tau), np.sin(k * tau)]) * (length / len(tau))
