"""Multipliers and the verdict on a cycle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hbbogie.brief import lines


@dataclass(frozen=True, eq=False)
class Stability:
    """Floquet multipliers of a cycle, or eigenvalues' exponentials of an equilibrium, and the verdict.

    Attributes
    ----------
    verdict : {"stable", "unstable", "unknown"}
    multipliers : ndarray of complex, shape (n_states,)
        Largest modulus first; for a cycle the trivial one is among them.
    trivial_error : float
        Distance of the nearest multiplier from 1 (0 for an equilibrium).
    unstable : int
        Number of multipliers outside the unit circle, the trivial one not counted.
    reason : str
        Why the verdict is what it is, a sentence.
    half_multipliers : ndarray of complex, shape (n_states,), or None
        Of an odd cycle, the multipliers of G = -Phi(T/2), in the order of those of the full period, which are
        their squares; the trivial one is +1, at a fold another is +1, at a symmetry-breaking pitchfork -1.
        None where the full period was integrated.
    critical : complex or None
        The nontrivial multiplier of largest modulus, over the full period.
    mode : ndarray of complex, shape (n_states,), or None
        Its eigenvector, the state of the disturbance at t = 0, scaled to a largest entry of 1 (all
        coordinates, then the velocities of those of second order).
    """

    verdict: str
    multipliers: NDArray[np.complex128]
    trivial_error: float
    unstable: int
    reason: str
    half_multipliers: NDArray[np.complex128] | None = None
    critical: complex | None = None
    mode: NDArray[np.complex128] | None = None

    def largest(self, cycle: bool = True) -> float | None:
        """Return the modulus of the largest multiplier, of a cycle but for the trivial one; None where unknown."""
        mu = np.asarray(self.multipliers)
        if cycle and len(mu):
            mu = np.delete(mu, np.argmin(np.abs(mu - 1)))
        return float(np.abs(mu).max()) if len(mu) and np.isfinite(mu).all() else None

    def __repr__(self) -> str:
        shown = [f"{m.real:.5g}" if m.imag == 0 else f"{m.real:.5g}{m.imag:+.5g}i" for m in self.multipliers[:SHOWN]]
        more = len(self.multipliers) - len(shown)
        listed = ", ".join(shown) + (f" and {more} smaller ones" if more > 0 else "")
        return lines(
            f"Stability: {self.verdict}",
            self.reason,
            f"multipliers {listed}" if shown else "no multipliers",
            f"{self.unstable} outside the unit circle; the trivial one is off by {self.trivial_error:.1g}",
        )


SHOWN = 4
