"""By how much harmonics left out, or any other error of a cycle at a fold, shift the fold: exact to first order."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hbbogie.errors import door
from hbbogie.methods.size import has_many_states
from hbbogie.model.conserved import conserved_quantities
from hbbogie.model.dynamics import state_of
from hbbogie.model.system import System
from hbbogie.results import Orbit
from hbbogie.stability.multipliers import is_halved
from hbbogie.stability.transitions import FIRST, Transitions, product, transitions_along
from hbbogie.stability.variation import Waveforms, on_lines

Array = NDArray[np.float64]
STEPS = 1024  # per period, where exponentials would serve for the transitions, but not for the integrals
PER_WAVE = 12  # intervals for each wave of the highest harmonic
SIMPSON = np.array([1.0, 4.0, 1.0]) / 6


@dataclass(frozen=True, eq=False)
class FoldShift:
    """What the equations of motion along the cycle at a fold tell of its error.

    Attributes
    ----------
    value : float, unit of the parameter
        What is to be added to the value of the fold.
    apart : float
        Distance from 1 of the multiplier that meets the trivial one at a fold.
    unstable : int
        Number of other multipliers outside the unit circle, beyond that distance. With any, the cycles on both sides
        of the fold are unstable near it.
    """

    value: float
    apart: float
    unstable: int


@door(system=System, orbit=Orbit, parameter=str)
def fold_shift(system: System, orbit: Orbit, parameter: str) -> FoldShift | None:
    """Return how far a fold is from where the cycle of an approximate method has it (eq-fold-shift).

    Along the cycle the equations of motion leave a defect. Where the cycle is near that of the fold, one adjoint
    solution of the variational equations tells by what the defect shifts the value of the parameter. The rest goes with
    the square of the cycle's error, as the shift itself does in smooth equations of first order, where half of it may
    be left. Where masses move and forces have kinks, a few hundredths are.

    Parameters
    ----------
    system : System
    orbit : Orbit
        The cycle at the fold, with its value of the parameter.
    parameter : str

    Returns
    -------
    FoldShift or None
        None for angles that run on, forces that jump, systems that conserve something, and more than 64 states.

    Raises
    ------
    ModelError
        For an unknown parameter.
    """
    p, place = system.vector(**orbit.parameters), system.parameter_names.index(system.parameter(parameter).name)
    if orbit.advance or has_many_states(system) or any(e.heights is not None for e in system.elements):
        return None
    waveforms = Waveforms(system, [orbit], p[None])
    size = waveforms.all_states.size[0]
    if len(conserved_quantities(system, p, size)):
        return None
    half = is_halved(system, orbit)
    pieces = -(-PER_WAVE * waveforms.H // FIRST)
    (along,) = transitions_along(waveforms, STEPS if waveforms.straight else None, half=half, pieces=pieces)
    monodromy = (-1.0 if half else 1.0) * product(along.matrices)
    if not np.isfinite(monodromy).all():
        return None
    size = np.where(size > 0, size, 1.0)
    rate = orbit.omega * waveforms.all_states.at(along.mesh[:1], 1)[0]
    rows = np.column_stack([monodromy - np.eye(len(size)), rate])
    speed = max(float(np.linalg.norm(rate)), 1e-300)
    scaled = rows / size[:, None] * np.append(size, np.linalg.norm(size) / speed)
    left = np.linalg.svd(scaled)[0][:, -1] / size  # no change of state or period gives a gap in this direction
    psi = np.empty((len(along.mesh), len(size)))
    psi[-1] = left
    for k in range(len(along.matrices) - 1, -1, -1):
        psi[k] = psi[k + 1] @ along.matrices[k]
    defect, slope = _integrals(waveforms, along, psi, place)
    multipliers = np.linalg.eigvals(monodromy)
    multipliers = multipliers[np.argsort(np.abs(multipliers - 1))]
    apart = np.abs(multipliers[1] - 1)
    unstable = (np.abs(multipliers[2:]) > 1 + apart).sum()
    return FoldShift(float(-defect / slope), float(apart), int(unstable)) if slope and np.isfinite(apart) else None


def _integrals(waveforms: Waveforms, along: Transitions, psi: Array, place: int) -> tuple[float, float]:
    """Return the integrals of psi . (f - dx/dt) and of psi . df/dp over the mesh, by Simpson's rule.

    Between its values at the ends of an interval the adjoint solution is a cubic, with the slopes of its own equation.
    """
    system, mesh, omega, p = waveforms.system, along.mesh, waveforms.omega[0], waveforms.p[0]
    N, n = len(mesh) - 1, system.n_states
    middle, lines = 0.5 * (mesh[1:] + mesh[:-1]), waveforms.lines(0.5 * (mesh[1:] + mesh[:-1]))
    run = system.once("defect", lambda: _defect(system))
    ends = [
        run(waveforms.all_states.at(tau).T, y.T, lines.T, p) for tau, y in ((mesh[:-1], psi[:-1]), (mesh[1:], psi[1:]))
    ]
    h = np.diff(mesh) / omega
    slopes = [-end[1].full().T for end in ends]
    between = 0.5 * (psi[:-1] + psi[1:]) + h[:, None] / 8 * (slopes[0] - slopes[1])
    x = waveforms.all_states.at(middle)
    f = [ends[0][0], run(x.T, between.T, lines.T, p)[0], ends[1][0]]
    rates = [omega * waveforms.all_states.at(tau, 1) for tau in (mesh[:-1], middle, mesh[1:])]
    total = sum(
        share * np.einsum("k,ki,ki->", h, y, value.full().T.reshape(N, n) - rate)
        for share, y, value, rate in zip(SIMPSON, (psi[:-1], between, psi[1:]), f, rates, strict=True)
    )
    by = system.once(("rates by", place), lambda: _rates_by(system, place))(x.T, p).full().T
    return float(total), float(np.einsum("k,ki,ki->", h, between, by))


def _defect(system: System) -> ca.Function:
    """Return (x, psi, lines, p) -> dx/dt and psi . A, with every contact on one of its lines."""
    q, v, lines, p, _, rates, _ = on_lines(system)
    x, psi = state_of(system.dynamics, q, v), ca.SX.sym("psi", system.n_states)
    return ca.Function("defect", [x, psi, lines, p], [ca.densify(rates), ca.densify(ca.jtimes(rates, x, psi, True))])


def _rates_by(system: System, place: int) -> ca.Function:
    """Return (x, p) -> derivative of dx/dt in a parameter."""
    x, p = ca.SX.sym("x", system.n_states), ca.SX.sym("p", len(system.parameters))
    return ca.Function("rates_by", [x, p], [ca.densify(ca.jacobian(system.ode(x, p), p[place]))])
