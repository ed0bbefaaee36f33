"""Multipliers that cross the unit circle: matched from cycle to cycle, and described where they cross."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
SMALLEST = 1e-8  # modulus below which multipliers are as good as equal


def logarithms(multipliers: Complex) -> Complex:
    """Return the logarithms of multipliers, of which those close to 0 are alike."""
    return np.asarray(np.log(np.maximum(np.abs(multipliers), SMALLEST)) + 1j * np.angle(multipliers))


def distances(a: Complex, b: Complex) -> Array:
    """Return the distance of each of the logarithms in a from each of those in b, angles up to whole turns."""
    away = a[:, None] - b
    turn = np.mod(away.imag + np.pi, 2 * np.pi) - np.pi
    return np.asarray(np.hypot(away.real, turn))


def matched(a: Complex, b: Complex) -> NDArray[np.int_]:
    """Return the place in b of each of the logarithms in a: the assignment of least distance in all."""
    return np.asarray(linear_sum_assignment(distances(a, b))[1])


def description(kind: str, multiplier: complex, half: bool) -> str:
    """Return what begins where a multiplier crosses the unit circle, a sentence.

    Parameters
    ----------
    kind : {"Neimark-Sacker", "pitchfork", "period doubling", "branch point"}
    multiplier : complex
    half : bool
        Whether it is one of half a period.
    """
    if kind == "Neimark-Sacker":
        whole = multiplier**2 if half else multiplier
        return f"a torus begins; multipliers {abs(whole):.8f} exp(+-{abs(np.angle(whole)):.6f} i) where located"
    begins = {"pitchfork": "the symmetry breaks", "period doubling": "a cycle of twice the period begins"}
    value = f"multiplier {complex(multiplier).real:.8f}{' of half a period' * half} where located"
    return f"{begins[kind]}; {value}" if kind in begins else value
