"""Peaks of the cycles at the folds of many designs at once."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import fields, replace

import numpy as np
from numpy.typing import NDArray

from hbbogie.exact.batch import Fold
from hbbogie.exact.closing import Frame
from hbbogie.exact.sequence import Sequence as Contacts
from hbbogie.exponential import REACH, exponentials

Array = NDArray[np.float64]

FINE, MOST = 16, 1024  # smallest and largest number of samples in a phase, more where its motion is fast
ITERATIONS = 5  # of Newton's method for a turning point, from half a sample away at most


def peaks(folds: Sequence[Fold]) -> Array:
    """Return the largest absolute value of each coordinate on the cycles at D folds, shape (D, n) [its unit]."""
    groups: dict[Contacts, list[int]] = defaultdict(list)
    for d, fold in enumerate(folds):
        groups[fold.closing.sequence].append(d)
    found = np.empty((len(folds), folds[0].closing.model.system.n if folds else 0))
    for members in groups.values():
        found[members] = _peaks([folds[d] for d in members])
    return found


def _peaks(folds: Sequence[Fold]) -> Array:
    """Return the peaks of folds with the same sequence, from samples and the turning points between them."""
    many = [fold.closing for fold in folds]
    frame = Frame(*(np.concatenate([getattr(c.frame, f.name) for c in many]) for f in fields(Frame)))
    closing = replace(many[0], p=np.concatenate([c.p for c in many]), frame=frame)
    y, n = np.array([fold.y for fold in folds]), closing.model.system.n
    x, best = np.append(y[:, : closing.n], np.ones((len(y), 1)), axis=1), np.zeros((len(y), n))
    matrices, sequence = closing.matrices(y)[0], closing.sequence
    for i, u in enumerate(sequence.of):
        A, h = matrices[:, u], y[:, closing.n + i]
        X, step = _samples(A, x, h)
        q, rate = np.abs(X[..., :n]), (X @ A.swapaxes(-1, -2))[..., :n]
        best = np.maximum(best, q.max(axis=1))
        rise = step[:, None, None] * np.maximum(np.abs(rate[:, :-1]), np.abs(rate[:, 1:]))
        beyond = np.maximum(q[:, :-1], q[:, 1:]) + rise >= best[:, None]  # no turning point lies farther out
        b, j, c = np.nonzero((rate[:, :-1] * rate[:, 1:] < 0) & beyond)
        if len(b):
            np.maximum.at(best, (b, c), np.abs(_turning(A[b], X[b, j], c, step[b])))
        x = X[:, -1]
    return best * frame.state[:, :n]


def _samples(A: Array, x: Array, h: Array) -> tuple[Array, Array]:
    """Return states at equal distances in a phase, both ends among them, shape (B, parts + 1, N), and the distances."""
    A2 = A @ A
    size = float((np.linalg.norm(A2 @ A2, axis=(1, 2)) ** 0.25 * np.abs(h)).max()) / REACH
    parts = 1 << int(np.ceil(np.log2(np.clip(size, FINE, MOST))))
    E = exponentials(A[:, None], np.zeros(1, dtype=int), (h / parts)[:, None])[-1][:, 0].swapaxes(-1, -2)
    X, ahead = x[:, None], E
    while X.shape[1] < parts:
        X, ahead = np.concatenate([X, X @ ahead], axis=1), ahead @ ahead
    return np.concatenate([X, X[:, -1:] @ E], axis=1), h / parts


def _turning(A: Array, x: Array, c: NDArray[np.int_], step: Array) -> Array:
    """Return coordinates c where their rates vanish within one step after states x, all of length K."""
    k, t = np.arange(len(x)), 0.5 * step
    for _ in range(ITERATIONS):
        here = (exponentials(A[None], k, t[None])[-1][0] @ x[..., None])[..., 0]
        rate = (A @ here[..., None])[..., 0]
        first, second = rate[k, c], np.einsum("kj,kj->k", A[k, c], rate)
        t = np.clip(t - np.divide(first, second, out=np.zeros_like(t), where=second != 0), 0.0, step)
    return np.asarray((exponentials(A[None], k, t[None])[-1][0] @ x[..., None])[k, c, 0])
