"""Closed motions by multiple shooting: Gauss collocation on elements between located contact times."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import splu

from hbbogie import fourier
from hbbogie.deadline import time_is_over
from hbbogie.errors import ModelError
from hbbogie.methods.size import has_many_states
from hbbogie.model.conserved import conserved_quantities
from hbbogie.model.system import System
from hbbogie.results import Orbit
from hbbogie.results.failure import ConvergenceError
from hbbogie.stability.elements import field_of, responses
from hbbogie.stability.paths import (
    INTEGRATE,
    NODES,
    STAGES,
    TO_LEGENDRE,
    WEIGHTS,
    NewtonStep,
    Path,
    Pattern,
    states_at,
)

Array = NDArray[np.float64]

FEWEST, MOST = 8, 3000  # elements per period
COARSE = 1e-6  # local error of the first mesh; the given waveform has small oscillations of its own
ITERATIONS, HALVINGS, REFINEMENTS = 30, 8, 12
LARGEST = 1500  # largest number of unknowns for which the shortest correction is computed
AT_ONCE = 3e5  # entries of a full matrix for each element whose derivatives are held at once
MEMORY, PER_ENTRY = 2e9, 300  # that shooting may take, and takes for each entry of all transition matrices [bytes]
SINGULAR = 1e-7  # smallest singular value of an isolated cycle's equations


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
        """Return scaled rates at the stages, shape (N, STAGES, n_states), and the entries of their derivatives."""
        N, _, n = path.stages.shape
        lines = np.repeat(self.pattern.lines[path.segment], STAGES, axis=0)
        f, entries = self.field((path.stages * self.scale).reshape(-1, n).T, lines.T, self.p)
        i, j = self.places
        scaled = entries.full().T.reshape(N, STAGES, -1) * (self.scale[j] / self.scale[i])
        return f.full().T.reshape(N, STAGES, n) / self.scale, scaled

    @cached_property
    def held(self) -> Array:
        """Rows of the quantities that the system conserves, shape (k, n_states)."""
        return conserved_quantities(self.system, self.p, self.scale)

    def trace(self, path: Path) -> float:
        """Return the integral of the trace of the rates' derivative over the period."""
        diagonal = np.equal(*self.places)
        traces = self.rates(path)[1][..., diagonal].sum(axis=2)
        return float(path.h @ (traces @ WEIGHTS))

    def linearise(self, path: Path) -> NewtonStep:
        """Return the equations and their derivatives, with the stages eliminated."""
        n, many = path.x.shape[1], has_many_states(self.system)
        parts = []
        for part in self._in_parts(path):
            f, J, ahead, residual = self._stages(part)
            ones = np.tile(np.eye(n), (len(f), STAGES, 1, 1))
            right = np.concatenate([residual[..., None], ones, ahead[..., None]], axis=-1)
            response = responses(part.h, INTEGRATE, J, right, many)
            weighted = (WEIGHTS[:, None, None] * J).swapaxes(1, 2).reshape(len(f), n, -1)
            end = part.h[:, None, None] * (weighted @ response.reshape(len(f), STAGES * n, -1))
            parts.append((f, residual, end, response[..., :0] if many else response))
        f, residual, end, response = (np.concatenate(part) for part in zip(*parts, strict=True))
        mismatch = path.x + path.h[:, None] * (WEIGHTS @ f) - np.roll(path.x, -1, axis=0)
        mismatch[-1] -= self.advance
        off, slope = self._contacts(path)
        error = np.nan_to_num(max(np.abs(a).max(initial=0.0) for a in (residual, mismatch, off)), nan=np.inf)
        gap, transitions, drift = mismatch + end[..., 0], np.eye(n) + end[..., 1:-1], end[..., -1] + WEIGHTS @ f
        return NewtonStep(f, float(error), gap, transitions, drift, response, off, slope)

    def _in_parts(self, path: Path) -> Iterator[Path]:
        """Yield the elements of a path, of many states a few at a time, whose derivatives take little memory."""
        N, n = path.x.shape
        size = max(1, int(AT_ONCE / n**2)) if has_many_states(self.system) else N
        for k in range(0, N, size):
            own = slice(k, k + size)
            parts = {name: getattr(path, name)[own] for name in ("segment", "share", "x", "stages")}
            yield replace(path, **parts)

    def _stages(self, path: Path) -> tuple[Array, Array, Array, Array]:
        """Return rates and derivatives at the stages, the integrals of the rates, and the residuals of the stages."""
        f, entries = self.rates(path)
        (i, j), J, ahead = self.places, np.zeros((*f.shape, f.shape[-1])), INTEGRATE @ f
        J[..., i, j] = entries
        return f, J, ahead, path.x[:, None] + path.h[:, None, None] * ahead - path.stages

    def _stage_steps(self, path: Path, step: NewtonStep, dx: Array, dd: Array) -> Array:
        """Return how the stages follow steps of the beginnings, and of the durations of the elements, shape (N,)."""
        if step.response.shape[-1]:
            steps = step.response[..., 0] + np.einsum("emsr,er->ems", step.response[..., 1:-1], dx)
            return np.asarray(steps + step.response[..., -1] * dd[:, None, None])
        found, k = [], 0
        for part in self._in_parts(path):
            _, J, ahead, residual = self._stages(part)
            own = slice(k, k + len(J))
            right = residual + dx[own, None] + ahead * dd[own, None, None]
            found.append(responses(part.h, INTEGRATE, J, right[..., None], True)[..., 0])
            k += len(J)
        return np.concatenate(found)

    def gaps(self, path: Path) -> Array:
        """Return the end of each element, with its stages solved for, minus the beginning of the next; scaled."""
        gap, many = path.x - np.roll(path.x, -1, axis=0), has_many_states(self.system)
        gap[-1] -= self.advance
        ends = []
        for part in self._in_parts(path):
            f, J, _, residual = self._stages(part)
            moved = responses(part.h, INTEGRATE, J, residual[..., None], many)[..., 0]
            ends.append(part.h[:, None] * (WEIGHTS @ f + np.einsum("m,emrs,ems->er", WEIGHTS, J, moved)))
        return np.asarray(gap + np.concatenate(ends))

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
        stages = self._stage_steps(path, step, dx, dd[path.segment] * path.share)
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
        """Return the closed motion on a mesh fine enough for the tolerance; `ModelError` where it takes too much."""
        path = self.start(max(tolerance, COARSE))
        self._check_memory(len(path.x))
        path, step = self.newton(path, max(1e-2 * tolerance, 1e-13))
        for _ in range(REFINEMENTS):
            pieces = self.pieces(path, step.f, tolerance)
            if (pieces == 1).all():
                return path, step
            if pieces.sum() > MOST:
                break
            self._check_memory(int(pieces.sum()))
            path, step = self.newton(self.split(path, step.f, pieces), max(1e-2 * tolerance, 1e-13))
        raise ConvergenceError(
            f"system {self.system.name!r}: {MOST} elements do not resolve the motion to {tolerance:g}; give a larger "
            "tolerance, or write a kink of the equations as an element.",
            orbit=self.orbit,
        )

    def _check_memory(self, elements: int) -> None:
        """Raise `ModelError` where the transition matrices of so many elements would take too much memory."""
        n = self.system.n_states
        if has_many_states(self.system) and (size := PER_ENTRY * elements * n**2) > MEMORY:
            raise ModelError(
                f"verify: {self.system.name!r} has {n} states, with which shooting on {elements} elements would take "
                f"about {size / 1e9:.2g} GB of memory; the limit is {MEMORY / 1e9:g} GB. What to try: the errors by "
                "fewer harmonics in errors of a cycle of find_cycles, or the motion from the cycle, "
                "simulate(system, orbit, 20 * orbit.period, method='cvodes')."
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
