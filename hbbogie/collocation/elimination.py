"""The linear algebra of collocation: a cycle of intervals reduced to one interval, in batches.

The equations of an interval are C x + D y + G (T, parameter) = g, x the state at its beginning and y at its end. A few
neighbours become one by a QR factorisation that takes the states between them out, level by level.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from hbbogie.brief import brief

Array = NDArray[np.float64]
FAMILY = 1e-6  # smallest singular value, relative to the largest, of an isolated cycle's equations
GROWTH = 100.0  # of states over neighbours up to which these are composed, at the cost of so many round-offs
WIDTH = 16  # rows of a group of intervals: a few at once for small systems, for which the calls cost more than the sums


@dataclass(frozen=True, eq=False)
class Composed:
    """How the states inside K groups of g intervals follow from that at their beginning, where none of them grows much.

    Attributes
    ----------
    W : ndarray, shape (K, g, n, n)
        From each of the states to the next.
    inside : ndarray, shape (K, (g - 1) n, n + 3)
        The states inside are the first columns times that at the beginning, less the next two times (T, parameter),
        plus the last.
    border : ndarray, shape (K, 2, (g - 1) n)
        The bordering rows at the states inside.
    """

    W: Array
    inside: Array
    border: Array

    __repr__ = brief

    turned = 0

    def between(self, begins: Array, ends: Array, rest: Array) -> Array:
        """Return the states inside, shape (K, (g - 1) n), of those at both ends."""
        n = begins.shape[1]
        return np.asarray((self.inside[..., :n] @ begins[..., None])[..., 0] + self.inside[..., n:] @ rest)

    def factors(self, lower: Array, border: Array) -> Array:
        """Return the factors of all rows, shape (K, g n), of those of the rows that are left and of the border."""
        K, g, n = self.W.shape[:3]
        at = (border @ self.border).reshape(K, g - 1, n)
        found = np.empty((K, g, n))
        found[:, -1] = lower
        for j in range(g - 2, -1, -1):
            found[:, j] = (found[:, j + 1, None] @ self.W[:, j + 1])[:, 0] - at[:, j]
        return found.reshape(K, g * n)


@dataclass(frozen=True, eq=False)
class Orthogonal:
    """How the states inside K groups of g intervals follow from those at their ends.

    Attributes
    ----------
    Q : ndarray, shape (K, g n, g n)
    R : ndarray, shape (K, (g - 1) n, (g - 1) n)
    inside : ndarray, shape (K, (g - 1) n, 2 n + 3)
        R^-1 times the rows of a group: the states inside are minus its first columns times those at both ends and minus
        the next two times (T, parameter) plus the last.
    border : ndarray, shape (K, 2, (g - 1) n)
        The bordering rows at the states inside.
    """

    Q: Array
    R: Array
    inside: Array
    border: Array

    __repr__ = brief

    @property
    def turned(self) -> int:
        """Number of factors -1 of the determinant: each of the reflections has one, and each negative pivot."""
        return int(np.count_nonzero(np.diagonal(self.R, axis1=1, axis2=2) > 0))

    def between(self, begins: Array, ends: Array, rest: Array) -> Array:
        """Return the states inside, shape (K, (g - 1) n), of those at both ends."""
        both = np.concatenate([begins, ends], axis=1)
        k = both.shape[1]
        return np.asarray(self.inside[..., k:] @ rest - (self.inside[..., :k] @ both[..., None])[..., 0])

    def factors(self, lower: Array, border: Array) -> Array:
        """Return the factors of all rows, shape (K, g n), of those of the rows that are left and of the border."""
        upper = -np.linalg.solve(self.R.swapaxes(1, 2), (border @ self.border)[..., None])
        return np.asarray((self.Q @ np.concatenate([upper, lower[..., None]], axis=1))[..., 0])


@dataclass(frozen=True, eq=False)
class Reduced:
    """A cycle of intervals reduced to one interval and two bordering rows.

    Attributes
    ----------
    levels : list of Composed or Orthogonal
    C, D, G : ndarray, shape (n, n), (n, n) and (n, 3)
        C x + D y + G[:, :2] (T, parameter) = G[:, 2]; y = x closes the cycle.
    border : ndarray, shape (2, n + 3)
        The bordering rows: x, T, parameter, and what they are to be.
    """

    levels: list[Composed | Orthogonal]
    C: Array
    D: Array
    G: Array
    border: Array

    __repr__ = brief

    @cached_property
    def matrix(self) -> Array:
        """The bordered equations, shape (n + 2, n + 2)."""
        return np.concatenate([np.concatenate([self.C + self.D, self.G[:, :2]], axis=1), self.border[:, :-1]])

    @cached_property
    def sign(self) -> float:
        """Sign of the determinant of all equations, but for a factor that depends on the number of intervals only."""
        turned = sum(level.turned for level in self.levels)
        return float((-1) ** turned * np.linalg.slogdet(self.matrix)[0])

    @cached_property
    def _sizes(self) -> Array:
        """Singular values of the bordered equations, the largest first."""
        return np.asarray(np.linalg.svd(self.matrix, compute_uv=False))

    @property
    def family(self) -> bool:
        """Whether the bordered equations are singular: the cycle is one of a family, or a fold."""
        return bool(self._sizes[-1] <= FAMILY * self._sizes[0])

    @property
    def singular(self) -> float:
        """Smallest singular value of the bordered equations with the sign of the determinant."""
        return self.sign * float(self._sizes[-1])

    @property
    def composed(self) -> bool:
        """Whether all intervals are composed: D is then 1, and -C the monodromy matrix."""
        return all(isinstance(level, Composed) for level in self.levels)

    def solve(self, shortest: bool = False) -> tuple[Array, Array]:
        """Return the states where the intervals begin, shape (N, n), and (T, parameter).

        Of many solutions, as in a family of cycles, the shortest in the unknowns that are left if that is asked for.

        Raises
        ------
        numpy.linalg.LinAlgError
            Where the equations are singular.
        """
        n = len(self.C)
        right = np.append(self.G[:, 2], self.border[:, -1])
        y = np.linalg.lstsq(self.matrix, right, rcond=FAMILY)[0] if shortest else np.linalg.solve(self.matrix, right)
        x, rest = np.asarray(y[None, :n], dtype=float), np.append(-y[n:], 1.0)
        for level in self.levels[::-1]:
            K = len(level.border)
            between = level.between(x[:K], np.roll(x, -1, axis=0)[:K], rest)
            x = np.concatenate([np.concatenate([x[:K], between], axis=1).reshape(-1, n), x[K:]])
        return x, np.asarray(y[n:], dtype=float)

    def adjoint(self) -> tuple[Array, Array]:
        """Return the combination of all rows that is zero but for the parameter, where it is 1.

        Returns
        -------
        ndarray, shape (N, n)
            Factors of the equations of the intervals.
        ndarray, shape (2,)
            Those of the bordering rows.
        """
        n = len(self.C)
        right = np.zeros(n + 2)
        right[n + 1] = 1.0
        y = np.linalg.solve(self.matrix.T, right)
        lower, border = np.asarray(y[None, :n], dtype=float), np.asarray(y[n:], dtype=float)
        for level in self.levels[::-1]:
            K = len(level.border)
            lower = np.concatenate([level.factors(lower[:K], border).reshape(-1, n), lower[K:]])
        return lower, border


def reduced(W: Array, H: Array, border: Array, corner: Array) -> Reduced:
    """Reduce a cycle of N intervals to one.

    Neighbours in which nothing grows by much are composed; the others by structured orthogonal factorisation.

    Parameters
    ----------
    W, H : ndarray, shape (N, n, n) and (N, n, 3)
        The state at the end of each interval is W x - H[..., :2] (T, parameter) + H[..., 2].
    border : ndarray, shape (N, 2, n)
        Two more rows, at the states where the intervals begin.
    corner : ndarray, shape (2, 3)
        The same at T and the parameter, and what the rows are to be.

    References
    ----------
    S. J. Wright, SIAM J. Sci. Stat. Comput. 13 (1992) 742-764.
    """
    levels: list[Composed | Orthogonal] = []
    n = W.shape[1]
    WH, corner = np.concatenate([W, H], axis=2), corner.copy()
    sizes = sorted({2, max(WIDTH // n, 2)}, reverse=True)  # of groups; the larger until something grows over them
    while len(WH) > 1 and sizes:
        if found := _composed(WH, border, corner, min(sizes[0], len(WH))):
            level, WH, border = found
            levels.append(level)
        else:
            del sizes[0]
    C, D, G = -WH[..., :n], np.broadcast_to(np.eye(n), (len(WH), n, n)), WH[..., n:]
    while len(C) > 1:
        factored, C, D, G, border = _factored(C, D, G, border, corner)
        levels.append(factored)
    return Reduced(levels, C[0], D[0], G[0], np.concatenate([border[0], corner], axis=1))


def _composed(WH: Array, border: Array, corner: Array, g: int) -> tuple[Composed, Array, Array] | None:
    """Compose g neighbours each; None where something grows by too much. The corner is changed in place."""
    N, n = WH.shape[:2]
    K = N // g
    used = K * g
    W = WH[:used, :, :n].reshape(K, g, n, n)
    growth = np.abs(W).sum(axis=3).max(axis=2)  # of the largest scaled state
    if not np.maximum(growth, 1.0).prod(axis=1).max() <= GROWTH:
        return None
    whole = WH[:used].reshape(K, g, n, n + 3)
    inside = np.empty((K, g - 1, n, n + 3))
    last = inside[:, 0] = whole[:, 0]
    for j in range(1, g):
        last = W[:, j] @ last
        last[..., n:] += whole[:, j, :, n:]
        if j < g - 1:
            inside[:, j] = last
    inside = inside.reshape(K, (g - 1) * n, n + 3)
    grouped = border[:used].reshape(K, g, 2, n).swapaxes(1, 2).reshape(K, 2, g * n)
    level = Composed(W, inside, grouped[..., n:])
    moved = level.border @ inside
    kept = np.concatenate([grouped[..., :n] + moved[..., :n], border[used:]])
    corner -= moved[..., n:].sum(axis=0)
    return level, np.concatenate([last, WH[used:]]), kept


def _factored(
    C: Array, D: Array, G: Array, border: Array, corner: Array
) -> tuple[Orthogonal, Array, Array, Array, Array]:
    """Factor neighbours by QR. The corner is changed in place."""
    N, n = C.shape[:2]
    g = min(max(WIDTH // n, 2), N)
    K = N // g
    inside, used = (g - 1) * n, K * g
    first, last = slice(0, used, g), slice(g - 1, used, g)
    M, rows = np.zeros((K, g, n, g - 1, n)), np.zeros((K, g, n, 2 * n + 3))
    for j in range(g - 1):
        M[:, j, :, j], M[:, j + 1, :, j] = D[j:used:g], C[j + 1 : used : g]
    rows[:, 0, :, :n], rows[:, -1, :, n : 2 * n] = C[first], D[last]
    rows[..., 2 * n :] = G[:used].reshape(K, g, n, 3)
    Q, R = np.linalg.qr(M.reshape(K, g * n, inside), mode="complete")
    turned = Q.swapaxes(1, 2) @ rows.reshape(K, g * n, -1)
    R = R[:, :inside]
    solved, lower = np.linalg.solve(R, turned[:, :inside]), turned[:, inside:]
    grouped = border[:used].reshape(K, g, 2, n).swapaxes(1, 2).reshape(K, 2, g * n)
    level = Orthogonal(Q, R, solved, grouped[..., n:])
    moved = level.border @ solved
    kept = np.concatenate([grouped[..., :n], border[used:]])
    kept[:K] -= moved[..., :n]
    kept[(np.arange(K) + 1) % len(kept)] -= moved[..., n : 2 * n]
    corner -= moved[..., 2 * n :].sum(axis=0)
    C = np.concatenate([lower[..., :n], C[used:]])
    D = np.concatenate([lower[..., n : 2 * n], D[used:]])
    return level, C, D, np.concatenate([lower[..., 2 * n :], G[used:]]), kept
