"""Attraction measured in time: the critical multiplier of a cycle, from simulated motions beside it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hbbogie.brief import brief
from hbbogie.errors import ModelError, door, positive
from hbbogie.model.system import System
from hbbogie.motion.integration import simulate
from hbbogie.results import Orbit
from hbbogie.stability.jumps import passages_along
from hbbogie.stability.transitions import product, transitions_along
from hbbogie.stability.variation import Waveforms, check_orbit
from hbbogie.stability.verification import verify

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

SAMPLES = 64  # per period; no step of CVODES is longer than the time between two
LARGEST = 30.0  # largest factor by which the disturbance may grow
FADED = 1e-5  # share of the disturbance below which it is lost in the errors of the integrator
MOST = 12  # periods


@dataclass(frozen=True, eq=False)
class Attraction:
    """The rate at which motions beside a cycle approach it or leave it, by simulation.

    Attributes
    ----------
    measured : complex
        The critical multiplier, fitted to the simulated motions; NaN if it could not be measured.
    predicted : complex
        The critical multiplier according to Floquet theory.
    difference : float
        Distance between the two, relative to the predicted one; NaN if nothing was measured.
    verdict : {"attracts", "repels", "unknown"}
        According to the measured multiplier.
    shares : ndarray of complex, shape (periods + 1,)
        Component of the disturbance along the critical mode after each period; the first is 1.
    scatter : float
        Largest distance of a single period's multiplier from the measured one, relative to the latter.
    disturbance : float
        Size of the initial disturbance relative to the ranges of the states.
    status : str
        A sentence.
    """

    measured: complex
    predicted: complex
    difference: float
    verdict: str
    shares: Complex
    scatter: float
    disturbance: float
    status: str

    __repr__ = brief


@door(system=System, orbit=Orbit)
def measure_attraction(
    system: System, orbit: Orbit, *, disturbance: float = 1e-4, tolerance: float = 1e-11, polish: bool = True
) -> Attraction:
    """Measure the critical multiplier of a cycle by simulating motions beside it.

    Parameters
    ----------
    system : System
    orbit : Orbit
        A cycle, stable or not. The parameter values are those of the orbit.
    disturbance : float
        Size of the disturbance relative to the ranges of the states over the cycle.
    tolerance : float
        Relative tolerance of the integration by CVODES.
    polish : bool
        Whether the cycle is polished by shooting first (see `verify`).

    Returns
    -------
    Attraction
        If the disturbance is lost within one period, nothing is measured, and the status gives the reason.

    Raises
    ------
    ModelError
        When the orbit is not a cycle of the system, or a number is not acceptable.
    ConvergenceError
        When the cycle cannot be polished, or the motion blows up.

    Notes
    -----
    Two motions begin on either side of the cycle, displaced by plus and minus a small multiple of the real part of the
    critical mode of the monodromy matrix, with multiplier mu. To first order, half their difference d_k after k periods
    is the k-th power of the monodromy matrix applied to that multiple. A small drift that both have in common cancels.
    The component of d_k along the mode, with the adjoint mode w (w* M = mu w*), is w* d_k = mu^k w* d_0, because w is
    orthogonal to the other modes, including the shift in time (eq-attraction). The multiplier is fitted to log(w* d_k)
    by least squares. The adjoint mode comes from the variational equations. The growth comes from the simulation alone.
    """
    positive("disturbance", disturbance, "1")
    check_orbit(system, orbit)
    if orbit.H == 0 or system.n_states < 2:
        raise ModelError(
            f"system {system.name!r}: the orbit is an equilibrium, or has only the trivial multiplier; "
            "give a cycle of a system with at least two states."
        )
    cycle = verify(system, orbit).orbit if polish else orbit
    predicted, mode, adjoint, scale = _critical(system, cycle)
    growth = abs(predicted)
    if growth < FADED:
        left = f"{growth:.2g}" if growth > 1e-12 else "less than 1e-12"
        reason = f"a disturbance shrinks to {left} of itself within one period, too fast to be measured"
        return Attraction(np.nan, predicted, np.nan, "unknown", np.ones(1, complex), np.nan, disturbance, f"{reason}.")
    if growth > 1:
        periods = min(MOST, max(1, int(np.log(LARGEST) / np.log(growth))))
        disturbance = disturbance / max(1.0, growth / LARGEST)
    else:
        periods = min(MOST, max(1, int(np.log(FADED) / np.log(growth))))
    step = disturbance * np.real(mode) / np.abs(np.real(mode) / scale).max()
    ends = [_after_periods(system, cycle, sign * step, periods, tolerance) for sign in (1.0, -1.0)]
    difference = 0.5 * (ends[0] - ends[1])
    shares = difference @ adjoint.conj()
    shares = shares / shares[0]
    ratios = shares[1:] / shares[:-1]
    k = np.arange(periods + 1)
    turns = np.angle(ratios / predicted) + np.angle(predicted)  # near half a turn each may round to either side
    logarithm = np.log(np.abs(shares)) + 1j * np.r_[0.0, np.cumsum(turns)]
    measured = complex(np.exp((k * logarithm).sum() / (k**2).sum()))  # the slope of a line through log 1 at k = 0
    if predicted.imag == 0:  # the remaining imaginary part is round-off
        measured = complex(measured.real)
    off, scatter = abs(measured - predicted) / growth, float(np.abs(ratios / measured - 1).max())
    verdict = "attracts" if abs(measured) < 1 else "repels"
    status = (
        f"{verdict}: over {periods} period(s), disturbances of {disturbance:.1g} of the range are multiplied by "
        f"{_shown(measured)} per period; Floquet theory says {_shown(predicted)} (difference {100 * off:.2g} %, "
        f"scatter between periods {100 * scatter:.2g} %)."
    )
    if scatter > 0.1 or (periods == 1 and off > 0.1):
        why = "the growth differs from period to period" if periods > 1 else "one period cannot confirm the growth"
        verdict, status = "unknown", f"{why}, so nothing was measured; take a smaller disturbance. {status}"
        return Attraction(np.nan, predicted, np.nan, verdict, shares, scatter, disturbance, status)
    return Attraction(measured, predicted, float(off), verdict, shares, scatter, disturbance, status)


def _shown(mu: complex) -> str:
    return f"{mu.real:.6g}" if abs(mu.imag) <= 1e-9 * abs(mu) else f"{mu.real:.6g}{mu.imag:+.6g}i"


def _critical(system: System, cycle: Orbit) -> tuple[complex, Complex, Complex, Array]:
    """Return the critical multiplier, its mode and adjoint mode at t = 0, and the ranges of the states."""
    waveforms = Waveforms(system, [cycle], system.vector(**cycle.parameters)[None])
    (along,) = transitions_along(waveforms)
    M = product(passages_along(waveforms, along.mesh).inserted(along.matrices))
    values, right = np.linalg.eig(M)
    left = np.linalg.inv(right).conj().T  # columns w with w* M = mu w* and w* v = 1
    trivial = int(np.argmin(np.abs(values - 1)))
    critical = max((i for i in range(len(values)) if i != trivial), key=lambda i: (abs(values[i]), values[i].imag))
    t = cycle.period * np.arange(SAMPLES) / SAMPLES
    states = np.hstack([cycle.q(t), cycle.v(t)[:, np.array(system.second_order)]])
    scale = np.maximum(np.ptp(states, axis=0), 1e-6 * np.ptp(states))
    return complex(values[critical]), right[:, critical].astype(complex), left[:, critical].astype(complex), scale


def _after_periods(system: System, cycle: Orbit, step: Array, periods: int, tolerance: float) -> Array:
    """Return the states after 0, 1, ... periods of a motion beside the cycle, shape (periods + 1, n_states)."""
    second = [i for i, s in enumerate(system.second_order) if s]
    names = [*system.coordinate_names, *(f"{system.coordinate_names[i]}'" for i in second)]
    start = np.r_[cycle.q(0.0)[0], cycle.v(0.0)[0, second]] + step
    motion = simulate(
        system,
        dict(zip(names, map(float, start), strict=True)),
        periods * cycle.period,
        method="cvodes",
        step=cycle.period / SAMPLES,
        tolerance=tolerance,
        **cycle.parameters,
    )
    kept = slice(None, None, SAMPLES)
    return np.hstack([motion.q[kept], motion.v[kept][:, second]])
