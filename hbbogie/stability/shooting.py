"""Closed motions by multiple shooting: Gauss collocation on elements between located contact times."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import splu

from hbbogie import fourier
from hbbogie.deadline import time_is_over
from hbbogie.methods.size import has_many_states
from hbbogie.model.conserved import conserved_quantities
from hbbogie.model.system import System
from hbbogie.results import Orbit
from hbbogie.results.failure import ConvergenceError
from hbbogie.stability.elements import field_of, responses

Array = NDArray[np.float64]

STAGES = 12  # Gauss points of an element, which give order 24 at its ends
FEWEST, MOST = 8, 3000  # elements per period
COARSE = 1e-6  # local error of the first mesh; the given waveform has small oscillations of its own
ITERATIONS, HALVINGS, REFINEMENTS = 30, 8, 12
LARGEST = 1500  # largest number of unknowns for which the shortest correction is computed
SINGULAR = 1e-7  # smallest singular value of an isolated cycle's equations


def _integrals(x: Array) -> Array:
    """Return the integrals from -1 to x of the Legendre polynomials 0 ... STAGES - 1, shape (len(x), STAGES)."""
    P = legendre.legvander(x, STAGES)
    k = np.arange(1, STAGES)
    return np.column_stack([x + 1, (P[:, 2:] - P[:, :-2]) / (2 * k + 1)])


_x, _w = legendre.leggauss(STAGES)
NODES, WEIGHTS = (_x + 1) / 2, _w / 2
TO_LEGENDRE = np.linalg.inv(legendre.legvander(_x, STAGES - 1))
INTEGRATE = _integrals(_x) @ TO_LEGENDRE / 2


@dataclass(frozen=True, eq=False)
class Pattern:
    """The order of contacts over a period: S segments, each of which begins when a contact changes its line.

    Attributes
    ----------
    starts, lengths : ndarray, shape (S,), rad
        Phases at which the segments begin, and their lengths.
    contact, level : ndarray, shape (S,) or (0,), the level in the unit of the contact's argument
        The contact that begins each segment, and its level; empty if no contact changes its line.
    lines : ndarray, shape (S, 2 contacts)
        Slope and intercept of each contact.
    """

    starts: Array
    lengths: Array
    contact: NDArray[np.int_]
    level: Array
    lines: Array


@dataclass(frozen=True, eq=False)
class Path:
    """A motion on N elements, in scaled states.

    Attributes
    ----------
    segment, share : ndarray, shape (N,)
        The segment in which each element lies, and its share of the segment's duration.
    x, stages : ndarray, shape (N, n_states) and (N, STAGES, n_states)
        States where the elements begin, and at their Gauss points.
    durations : ndarray, shape (S,), s
    """

    segment: NDArray[np.int_]
    share: Array
    x: Array
    stages: Array
    durations: Array

    @property
    def h(self) -> Array:
        """Duration of each element, shape (N,), s."""
        return self.durations[self.segment] * self.share


@dataclass(frozen=True, eq=False)
class NewtonStep:
    """Equations and derivatives at a path; the stages of each element are eliminated.

    Attributes
    ----------
    f, error : ndarray, shape (N, STAGES, n_states), 1/s, and float
        Rates at the stages, and the largest residual of all equations.
    gap : ndarray, shape (N, n_states)
        End of each element, with its stages solved for, minus the beginning of the next.
    transitions, drift : ndarray, shape (N, n_states, n_states) and (N, n_states)
        Derivatives of the end in the beginning and in the duration.
    response : ndarray, shape (N, STAGES, n_states, n_states + 2)
        Stages: correction, derivative in the beginning, derivative in the duration.
    off, slope : ndarray, shape (S,) and (S, n_states)
        The arguments of the contacts minus their levels, scaled, and derivatives.
    """

    f: Array
    error: float
    gap: Array
    transitions: Array
    drift: Array
    response: Array
    off: Array
    slope: Array


class Shooting:
    """The equations of closed motions with one order of contacts; the search begins at an orbit."""

    def __init__(self, system: System, orbit: Orbit, pattern: Pattern):
        self.system, self.orbit, self.pattern = system, orbit, pattern
        self.p = system.vector(**orbit.parameters)
        self.field, self.arguments, self.places = field_of(system)
        second = [i for i, s in enumerate(system.second_order) if s]
        self.second = second
        size = np.abs(self._guess(fourier.phases(max(256, 4 * orbit.H)))).max(axis=0)
        positions = np.arange(system.n_states) < system.n
        for group in (positions, ~positions):  # a state at rest must not require infinite precision
            size[group] = np.maximum(size[group], 1e-6 * size[group].max(initial=0.0))
        self.scale = np.where(size > 0, size, 1.0)
        self.advance = np.append(orbit.advance or np.zeros(system.n), np.zeros(len(second))) / self.scale

    def _guess(self, tau: Array) -> Array:
        """Return the states of the orbit at phases tau [rad], shape (len(tau), n_states)."""
        return np.hstack([self.orbit.at(tau), self.orbit.omega * self.orbit.at(tau, 1)[:, self.second]])

    def start(self, tolerance: float) -> Path:
        """Return the orbit's own waveform on a mesh that resolves it."""
        counts = np.maximum(1, np.ceil(FEWEST * self.pattern.lengths / (2 * np.pi))).astype(int)
        segment = np.repeat(np.arange(len(counts)), counts)
        share = 1.0 / counts[segment]
        for _ in range(REFINEMENTS):
            length = self.pattern.lengths[segment] * share
            begin = self.pattern.starts[0] + np.cumsum(length) - length
            tau = begin[:, None] + length[:, None] * np.r_[0.0, NODES]
            x = (self._guess(tau.ravel()) / self.scale).reshape(*tau.shape, -1)
            path = Path(segment, share, x[:, 0], x[:, 1:], self.pattern.lengths / self.orbit.omega)
            pieces = self.pieces(path, self.rates(path)[0], tolerance)
            if (pieces == 1).all() or pieces.sum() > MOST:
                break
            segment, share = np.repeat(segment, pieces), np.repeat(share / pieces, pieces)
        return path

    def pieces(self, path: Path, f: Array, tolerance: float) -> NDArray[np.int_]:
        """Return the number of pieces into which each element must be split, shape (N,)."""
        last = np.abs(np.einsum("km,ems->eks", TO_LEGENDRE[-2:], f)).max(axis=(1, 2)) * np.abs(path.h) / (2 * STAGES)
        return np.clip(np.ceil((last / tolerance) ** (1 / STAGES)), 1, 4).astype(int)

    def split(self, path: Path, f: Array, pieces: NDArray[np.int_]) -> Path:
        """Return the same motion with each element split into pieces."""
        e = np.repeat(np.arange(len(pieces)), pieces)
        k = np.arange(len(e)) - (np.cumsum(pieces) - pieces)[e]
        sigma = (k[:, None] + np.r_[0.0, NODES]) / pieces[e][:, None]
        x = states_at(path, f, np.repeat(e, STAGES + 1), sigma.ravel()).reshape(*sigma.shape, -1)
        return Path(path.segment[e], path.share[e] / pieces[e], x[:, 0], x[:, 1:], path.durations)

    def rates(self, path: Path) -> tuple[Array, Array]:
        """Return scaled rates, shape (N, STAGES, n_states), and their derivatives at the stages."""
        N, _, n = path.stages.shape
        lines = np.repeat(self.pattern.lines[path.segment], STAGES, axis=0)
        f, entries = self.field((path.stages * self.scale).reshape(-1, n).T, lines.T, self.p)
        (i, j), J = self.places, np.zeros((N, STAGES, n, n))
        J[..., i, j] = entries.full().T.reshape(N, STAGES, -1) * (self.scale[j] / self.scale[i])
        return f.full().T.reshape(N, STAGES, n) / self.scale, J

    @cached_property
    def held(self) -> Array:
        """Rows of the quantities that the system conserves, shape (k, n_states)."""
        return conserved_quantities(self.system, self.p, self.scale)

    def trace(self, path: Path) -> float:
        """Return the integral of the trace of the rates' derivative over the period."""
        traces = np.trace(self.rates(path)[1], axis1=2, axis2=3)
        return float(path.h @ (traces @ WEIGHTS))

    def linearise(self, path: Path) -> NewtonStep:
        """Return the equations and their derivatives, with the stages eliminated."""
        N, _, n = path.stages.shape
        f, J = self.rates(path)
        h, x1 = path.h[:, None, None], path.x + path.h[:, None] * (WEIGHTS @ f)
        ahead = INTEGRATE @ f
        residual = path.x[:, None] + h * ahead - path.stages
        right = np.concatenate([residual[..., None], np.tile(np.eye(n), (N, STAGES, 1, 1)), ahead[..., None]], axis=-1)
        response = responses(path.h, INTEGRATE, J, right, has_many_states(self.system))
        weighted = (WEIGHTS[:, None, None] * J).swapaxes(1, 2).reshape(N, n, -1)
        end = h * (weighted @ response.reshape(N, STAGES * n, -1))
        mismatch = x1 - np.roll(path.x, -1, axis=0)
        mismatch[-1] -= self.advance
        off, slope = self._contacts(path)
        error = np.nan_to_num(max(np.abs(a).max(initial=0.0) for a in (residual, mismatch, off)), nan=np.inf)
        gap, transitions, drift = mismatch + end[..., 0], np.eye(n) + end[..., 1:-1], end[..., -1] + WEIGHTS @ f
        return NewtonStep(f, float(error), gap, transitions, drift, response, off, slope)

    def _contacts(self, path: Path) -> tuple[Array, Array]:
        """Return how far each contact is from its level where its segment begins, scaled; derivatives."""
        contact, S, n = self.pattern.contact, len(self.pattern.contact), path.x.shape[1]
        if not S:
            return np.empty(0), np.empty((0, n))
        k = np.arange(S)
        first = np.searchsorted(path.segment, k)
        u, du = self.arguments((path.x[first] * self.scale).T, self.pattern.lines.T, self.p)
        derivative = du.full().reshape(-1, S, n)[contact, k] * self.scale
        span = np.abs(derivative).sum(axis=1)
        return (u.full()[contact, k] - self.pattern.level) / span, derivative / span[:, None]

    def matrix(self, path: Path, step: NewtonStep) -> csc_matrix:
        """Return the derivative of gaps and conditions in the beginnings and in the durations, relative to all.

        The last rows are the contact conditions. Without contacts, one row fixes the phase.
        """
        N, n = path.x.shape
        S, period = len(path.durations), path.durations.sum()
        block = np.arange(N * n).reshape(N, n)
        rows, columns = np.broadcast_arrays(block[:, :, None], block[:, None, :])
        if len(step.off):
            first = block[np.searchsorted(path.segment, np.arange(S))]
            condition = (np.repeat(N * n + np.arange(S), n), first.ravel(), step.slope.ravel())
        else:
            rate = step.f[:, 0] * path.share[:, None]
            condition = (np.full(N * n, N * n), block.ravel(), (rate / np.abs(rate).sum()).ravel())
        parts = [
            (rows.ravel(), columns.ravel(), step.transitions.ravel()),
            (block.ravel(), np.roll(block, -1, axis=0).ravel(), -np.ones(N * n)),
            (block.ravel(), np.repeat(N * n + path.segment, n), (step.drift * path.share[:, None] * period).ravel()),
            condition,
        ]
        i, j, values = (np.concatenate([part[k] for part in parts]) for k in range(3))
        return csc_matrix((values, (i, j)), shape=(N * n + S, N * n + S))

    def corrections(self, path: Path, step: NewtonStep) -> Iterator[Array]:
        """Yield corrections of beginnings and durations: Newton's, then the shortest, for a family of cycles."""
        matrix = self.matrix(path, step)
        right = -np.r_[step.gap.ravel(), step.off if len(step.off) else 0.0]
        if len(self.held):  # the sum of the gaps along these rows is none whatever the states: it takes their level
            n, rows = path.x.shape[1], self.held * self.scale
            rows = rows / np.linalg.norm(rows, axis=1, keepdims=True)
            rest = np.append(self.orbit.coefficients[0], np.zeros(n - self.system.n)) / self.scale
            matrix = matrix.tolil()
            last = slice((len(path.x) - 1) * n, len(path.x) * n)
            matrix[last, :n] = matrix[last, :n] + rows.T @ rows
            matrix = matrix.tocsc()
            right[last] += rows.T @ (rows @ (rest - path.x[0]))
        with suppress(RuntimeError):  # exactly singular
            yield splu(matrix).solve(right)
        if len(right) <= LARGEST:
            yield np.linalg.lstsq(matrix.toarray(), right, rcond=1e-5)[0]

    def improved(self, path: Path, step: NewtonStep, y: Array) -> tuple[Path, NewtonStep] | None:
        """Return the path a correction leads to, halved until the residual falls; None where it does not."""
        S, period = len(path.durations), path.durations.sum()
        dx, dd = y[:-S].reshape(path.x.shape), y[-S:] * period
        stages = step.response[..., 0] + np.einsum("emsr,er->ems", step.response[..., 1:-1], dx)
        stages += step.response[..., -1] * (dd[path.segment] * path.share)[:, None, None]
        long = path.durations > 1e-6 * period  # the segment between simultaneous contacts has no duration
        shrinking = float((-dd[long] / path.durations[long]).max())
        alpha = min(1.0, 0.8 / max(shrinking, 1e-300))
        for _ in range(HALVINGS if np.isfinite(y).all() else 0):
            x, durations = path.x + alpha * dx, path.durations + alpha * dd
            trial = replace(path, x=x, stages=path.stages + alpha * stages, durations=durations)
            with np.errstate(all="ignore"), suppress(np.linalg.LinAlgError):  # a step too far
                new = self.linearise(trial)
                if new.error < step.error:
                    return trial, new
            alpha /= 2
        return None

    def newton(self, path: Path, tolerance: float) -> tuple[Path, NewtonStep]:
        """Return the path that closes, and the equations there; raise `ConvergenceError` where there is none."""
        step = self.linearise(path)
        for _ in range(ITERATIONS):
            if step.error <= tolerance:
                return path, step
            if time_is_over():
                why = f"system {self.system.name!r}: the time limit was reached while shooting; raise limit to go on."
                raise ConvergenceError(why, orbit=self.orbit)
            tried = (self.improved(path, step, y) for y in self.corrections(path, step))
            better = next((found for found in tried if found), None)
            if better is None:
                break
            path, step = better
        if step.error <= 1e3 * tolerance:  # round-off
            return path, step
        raise ConvergenceError(
            f"system {self.system.name!r}: shooting from {self.orbit.method or 'the orbit'} ended with a residual of "
            f"{step.error:.2g}; the orbit is too far from a cycle. Take more harmonics.",
            orbit=self.orbit,
        )

    def close(self, tolerance: float) -> tuple[Path, NewtonStep]:
        """Return the closed motion on a mesh fine enough for the tolerance."""
        path, step = self.newton(self.start(max(tolerance, COARSE)), max(1e-2 * tolerance, 1e-13))
        for _ in range(REFINEMENTS):
            pieces = self.pieces(path, step.f, tolerance)
            if (pieces == 1).all():
                return path, step
            if pieces.sum() > MOST:
                break
            path, step = self.newton(self.split(path, step.f, pieces), max(1e-2 * tolerance, 1e-13))
        raise ConvergenceError(
            f"system {self.system.name!r}: {MOST} elements do not resolve the motion to {tolerance:g}; give a larger "
            "tolerance, or write a kink of the equations as an element.",
            orbit=self.orbit,
        )

    def isolation(self, path: Path, step: NewtonStep) -> float:
        """Return the smallest singular value of the scaled equations, estimated: about 0 in a family of cycles."""
        with suppress(RuntimeError), np.errstate(all="ignore"):  # singular to the last digit
            factors = splu(self.matrix(path, step))
            y = np.ones(factors.shape[0])
            for _ in range(5):
                y = factors.solve(factors.solve(y / np.linalg.norm(y)), trans="T")
            return float(np.linalg.norm(y) ** -0.5) if np.isfinite(y).all() else 0.0
        return 0.0


def states_at(path: Path, f: Array, element: NDArray[np.int_], sigma: ArrayLike) -> Array:
    """Return scaled states inside elements, sigma from 0 to 1, shape (len(sigma), n_states)."""
    basis = _integrals(2 * np.asarray(sigma) - 1) @ TO_LEGENDRE / 2
    return path.x[element] + path.h[element, None] * np.einsum("km,kms->ks", basis, f[element])
