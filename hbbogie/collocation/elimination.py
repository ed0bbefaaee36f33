"""The linear algebra of collocation: a cycle of intervals reduced to one interval, in batches.

The equations of an interval are C x + D y + G (T, parameter) = g, x the state at its beginning and y at its end. A few
neighbours become one by a QR factorisation that takes the states between them out, level by level.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hbbogie.brief import brief

Array = NDArray[np.float64]
FAMILY = 1e-6  # smallest singular value, relative to the largest, of an isolated cycle's equations
WIDTH = 16  # rows of a group of intervals: a few at once for small systems, for which the calls cost more than the sums


@dataclass(frozen=True, eq=False)
class Level:
    """How the states inside K groups of g intervals follow from those at their ends.

    Attributes
    ----------
    Q : ndarray, shape (K, g n, g n)
    R : ndarray, shape (K, (g - 1) n, (g - 1) n)
    between : ndarray, shape (K, (g - 1) n, 2 n + 3)
        R^-1 times the rows of a group: the states inside are minus its first columns times those at both ends and minus
        the next two times (T, parameter) plus the last.
    border : ndarray, shape (2, K, (g - 1) n)
        The bordering rows at the states inside.
    """

    Q: Array
    R: Array
    between: Array
    border: Array

    __repr__ = brief


@dataclass(frozen=True, eq=False)
class Reduced:
    """A cycle of intervals reduced to one interval and two bordering rows.

    Attributes
    ----------
    levels : list of Level
    C, D, G : ndarray, shape (n, n), (n, n) and (n, 3)
        C x + D y + G[:, :2] (T, parameter) = G[:, 2]; y = x closes the cycle.
    border : ndarray, shape (2, n + 3)
        The bordering rows: x, T, parameter, and what they are to be.
    """

    levels: list[Level]
    C: Array
    D: Array
    G: Array
    border: Array

    __repr__ = brief

    @property
    def matrix(self) -> Array:
        """The bordered equations, shape (n + 2, n + 2)."""
        return np.vstack([np.column_stack([self.C + self.D, self.G[:, :2]]), self.border[:, :-1]])

    @property
    def sign(self) -> float:
        """Sign of the determinant of all equations, but for a factor that depends on the number of intervals only."""
        turned = sum(int((np.diagonal(level.R, axis1=1, axis2=2) < 0).sum()) for level in self.levels)
        return float((-1) ** turned * np.linalg.slogdet(self.matrix)[0])

    @property
    def family(self) -> bool:
        """Whether the bordered equations are singular: the cycle is one of a family, or a fold."""
        sizes = np.linalg.svd(self.matrix, compute_uv=False)
        return bool(sizes[-1] <= FAMILY * sizes[0])

    @property
    def singular(self) -> float:
        """Smallest singular value of the bordered equations with the sign of the determinant."""
        return self.sign * float(np.linalg.svd(self.matrix, compute_uv=False)[-1])

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
        x, rest = y[None, :n], np.append(-y[n:], 1.0)
        for level in self.levels[::-1]:
            K = len(level.R)
            ends = np.concatenate([x[:K], np.roll(x, -1, axis=0)[:K]], axis=1)
            between = level.between[..., 2 * n :] @ rest - (level.between[..., : 2 * n] @ ends[..., None])[..., 0]
            x = np.concatenate([np.concatenate([x[:K], between], axis=1).reshape(-1, n), x[K:]])
        return np.asarray(x, dtype=float), np.asarray(y[n:], dtype=float)

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
        lower, border = y[None, :n], y[n:]
        for level in self.levels[::-1]:
            K = len(level.R)
            upper = -np.linalg.solve(level.R.swapaxes(1, 2), np.einsum("b,bkn->kn", border, level.border)[..., None])
            groups = level.Q @ np.concatenate([upper, lower[:K, :, None]], axis=1)
            lower = np.concatenate([groups.reshape(-1, n), lower[K:]])
        return np.asarray(lower, dtype=float), np.asarray(border, dtype=float)


def reduced(C: Array, D: Array, G: Array, border: Array, corner: Array) -> Reduced:
    """Reduce a cycle of N intervals to one, by structured orthogonal factorisation.

    Parameters
    ----------
    C, D, G : ndarray, shape (N, n, n), (N, n, n) and (N, n, 3)
        C x + D y + G[..., :2] (T, parameter) = G[..., 2] for each interval.
    border : ndarray, shape (2, N, n)
        Two more rows, at the states where the intervals begin.
    corner : ndarray, shape (2, 3)
        The same at T and the parameter, and what the rows are to be.

    References
    ----------
    S. J. Wright, SIAM J. Sci. Stat. Comput. 13 (1992) 742-764.
    """
    levels, n = [], C.shape[1]
    corner = corner.copy()
    while len(C) > 1:
        g = min(max(WIDTH // n, 2), len(C))
        K, inside = len(C) // g, (g - 1) * n
        used = K * g
        first, last = slice(0, used, g), slice(g - 1, used, g)
        M, rows = np.zeros((K, g, n, g - 1, n)), np.zeros((K, g, n, 2 * n + 3))
        for j in range(g - 1):
            M[:, j, :, j], M[:, j + 1, :, j] = D[j:used:g], C[j + 1 : used : g]
        rows[:, 0, :, :n], rows[:, -1, :, n : 2 * n] = C[first], D[last]
        rows[..., 2 * n :] = G[:used].reshape(K, g, n, 3)
        Q, R = np.linalg.qr(M.reshape(K, g * n, inside), mode="complete")
        turned = Q.swapaxes(1, 2) @ rows.reshape(K, g * n, -1)
        R = R[:, :inside]
        between, lower = np.linalg.solve(R, turned[:, :inside]), turned[:, inside:]
        grouped = border[:, :used].reshape(2, K, g * n)
        levels.append(Level(Q, R, between, grouped[..., n:]))
        moved = np.einsum("bkn,knc->bkc", grouped[..., n:], between)
        kept = np.concatenate([grouped[..., :n], border[:, used:]], axis=1)
        kept[:, :K] -= moved[..., :n]
        kept[:, (np.arange(K) + 1) % kept.shape[1]] -= moved[..., n : 2 * n]
        corner -= moved[..., 2 * n :].sum(axis=1)
        border = kept
        C = np.concatenate([lower[..., :n], C[used:]])
        D = np.concatenate([lower[..., n : 2 * n], D[used:]])
        G = np.concatenate([lower[..., 2 * n :], G[used:]])
    return Reduced(levels, C[0], D[0], G[0], np.concatenate([border[:, 0], corner], axis=1))
