"""Cycles solved for on a mesh that adapts: Newton's method, the next degree as error estimate, more intervals."""

from __future__ import annotations

from dataclasses import replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hbbogie.collocation.contacts import SETTLED, contact_times, through, through_contacts
from hbbogie.collocation.cycle import CollocatedCycle, cycle_of
from hbbogie.collocation.equations import Linearised, OnMesh
from hbbogie.collocation.mesh import equidistributed
from hbbogie.collocation.multipliers import Spectrum, spectrum_of, stability_of
from hbbogie.collocation.rates import Rates
from hbbogie.collocation.starting import Sampled
from hbbogie.errors import ModelError, door, positive, whole
from hbbogie.model.conserved import conserved_quantities
from hbbogie.model.system import System
from hbbogie.model.turns import check_advance
from hbbogie.polynomials import evaluated, slopes_of
from hbbogie.results.failure import ConvergenceError

Array = NDArray[np.float64]
FIRST, MOST = 40, 2560  # intervals to begin with, and at most
ITERATIONS, HALVINGS = 40, 6
RESIDUAL = 1e-9  # largest scaled residual
SETTLING = 12  # solutions after which contact times lie on the mesh
ADAPTIONS = 3  # of the mesh before the first error estimate
FARTHEST = 0.7  # longest step of log T
SAMPLES, REPEATED = 96, 1e-5  # of a period, and distance in units of the ranges, by which one is told that repeats
SHRUNK = 1e-2  # share of the guess's range at which a cycle counts as lost


class Guess(Protocol):
    """Where a search for a cycle begins."""

    @property
    def parameters(self) -> dict[str, float]:
        """Value of every parameter."""

    def on(self, N: int, degree: int) -> CollocatedCycle:
        """Return the guess on a mesh of N intervals of some degree."""


def check_guess(system: System, guess: Guess) -> None:
    """Raise `ModelError` where a guess has other parameters than the system, as that of another one has."""
    if set(guess.parameters) != set(system.parameter_names):
        raise ModelError(
            f"the guess has the parameters {', '.join(guess.parameters) or '(none)'}, and the system {system.name!r} "
            f"has {', '.join(system.parameter_names) or '(none)'}; give a guess that was made with this system."
        )


def on_mesh(rates: Rates, guess: CollocatedCycle, width: float = 1.0) -> tuple[OnMesh, Array]:
    """Return the equations on the mesh of a guess, and its unknowns.

    Raises
    ------
    ModelError
        When the system conserves a quantity.
    """
    system = rates.system
    p = system.vector(**guess.parameters)
    range_ = np.ptp(guess.values, axis=(0, 1))
    size = np.maximum(range_, 1e-9 * float(range_.max()))
    if len(conserved := conserved_quantities(system, p, size)):
        raise ModelError(
            f"system {system.name!r}: {len(conserved)} linear quantity(ies) are conserved, so that its cycles are not "
            "isolated; write it with fewer coordinates, or take HarmonicBalance."
        )
    if guess.advance:
        check_advance(system.dynamics, guess.advance)
    equations = OnMesh(rates, guess.mesh, guess.degree, size, width, p, guess.values, guess.advance)
    value = 0.0 if rates.place is None else float(p[rates.place])
    u = equations.pack(guess.values, guess.period, value)
    return replace(equations, sides=equations.sides_at(guess.mesh, u)), u


def newton(equations: OnMesh, u: Array, tolerance: float = RESIDUAL) -> tuple[Array, Linearised]:
    """Solve the equations at the parameters of the guess, by Newton's method with damping.

    Raises
    ------
    ConvergenceError
        Where it does not converge.
    """
    plane = np.zeros(len(u))
    plane[-1] = 1.0
    line, met = equations.linearise(u), False
    error = _size(line)
    for iteration in range(ITERATIONS):
        better = None
        for shortest in (False, True):  # of a family of cycles the correction to the nearest
            try:
                step, _ = line.solve(plane, -np.append(line.residual, 0.0), shortest)
            except np.linalg.LinAlgError:
                continue
            if met:
                return u, line
            better = _improved(equations, u, step, error, tolerance)
            if better is not None or line.reduced is None or not line.reduced.family:
                break
        if better is None:
            # of stiff equations what is left is round-off
            if error <= 1e3 * tolerance and iteration:
                return u, line
            break
        u, line, error = better
        met = error <= tolerance
    raise ConvergenceError(
        f"system {equations.rates.system.name!r}: Newton's method did not converge on {equations.N} intervals, largest "
        f"scaled residual {error:.2g}; the guess is too far from a cycle, or there is none."
    )


def _improved(
    equations: OnMesh, u: Array, step: Array, error: float, tolerance: float
) -> tuple[Array, Linearised, float] | None:
    """Return unknowns a step leads to, halved until the residual falls, with the equations there and the residual."""
    alpha = min(1.0, FARTHEST / max(abs(float(step[-2])), 1e-300))
    for _ in range(HALVINGS):
        trial = u + alpha * equations.scale * step
        with np.errstate(all="ignore"):
            there = equations.linearise(trial)
        if (size := _size(there)) < error or (alpha == 1.0 and size <= tolerance):
            return trial, there, size
        alpha /= 2
    return None


def _size(line: Linearised) -> float:
    size = float(np.abs(line.residual).max())
    return size if np.isfinite(size) else np.inf


Errors = tuple[float, float, float, float]


def errors_of(equations: OnMesh, u: Array, plane: Array | None = None) -> tuple[Errors, Linearised]:
    """Return estimates of errors, by one Newton step at the next degree.

    Parameters
    ----------
    equations : OnMesh
    u : ndarray
        A solution.
    plane : ndarray, optional
        Across which the step is taken, in unknowns of the next degree; that of the fixed parameter where left out.

    Returns
    -------
    (float, float, float, float)
        Of the period, relative; of the states where intervals begin, relative to their ranges, or in time relative to
        the period where they are steep; of the states anywhere, relative to their ranges;
        of the parameter, in units of what counts as much as one of a scaled state.
    Linearised
        The equations of the next degree, solved once.
    """
    finer, v = equations.moved(equations.mesh, equations.m + 1, u)
    line = finer.linearise(v)
    if plane is None:
        plane = np.zeros(len(v))
        plane[-1] = 1.0
    step, _ = line.solve(plane, -np.append(line.residual, 0.0))
    if line.reduced is not None and line.reduced.family:
        step, _ = line.solve(plane, -np.append(line.residual, 0.0), shortest=True)
    states = np.abs(step[finer.N * finer.m * finer.n : -2]).reshape(finer.N, finer.n)
    begins = slopes_of(finer.m)[0] @ (finer.unpack(v)[0] / finer.size)
    rate = begins / np.diff(finer.mesh)[:, None]
    curve = float((states / np.maximum(1.0, np.abs(rate))).max())
    return (abs(float(step[-2])), curve, float(np.abs(step[:-2]).max()), abs(float(step[-1]))), line


def adapted(equations: OnMesh, u: Array, N: int) -> tuple[OnMesh, Array]:
    """Return the equations on the mesh of N intervals on which the errors of a cycle are equal, and the unknowns."""
    mesh = equidistributed(equations.mesh, equations.unpack(u)[0] / equations.size, N, equations.kinks)
    return equations.moved(through(mesh, contact_times(equations, u)), equations.m, u)


def settled(equations: OnMesh, u: Array, line: Linearised) -> tuple[OnMesh, Array, Linearised]:
    """Return a solution on the mesh that has its own contact times as points.

    A contact that begins within an interval instead of at its end is taken for one on the wrong line for as long as it
    is off, which moves its time by the square of that.

    Raises
    ------
    ConvergenceError
        When the times do not settle.
    """
    for _ in range(SETTLING):
        mesh = through_contacts(equations, u)
        if mesh is None:
            return equations, u, line
        equations, before = equations.moved(mesh, equations.m, u)
        u, line = newton(equations, before)
        if np.abs((u - before) / equations.scale).max() <= SETTLED:
            return equations, u, line
    raise ConvergenceError(
        f"system {equations.rates.system.name!r}: the contact times did not settle on the mesh; a contact may only "
        "just touch. Take HarmonicBalance, or other parameters."
    )


@door(system=System, guess=(Sampled, CollocatedCycle))
def collocated(
    system: System,
    guess: Guess,
    *,
    degree: int = 4,
    intervals: int | None = None,
    most: int = MOST,
    tolerance: float = 1e-9,
    stability: bool = True,
) -> CollocatedCycle:
    """Solve for a cycle on a mesh that adapts, at the parameters of the guess.

    Parameters
    ----------
    system : System
    guess : Guess
        Such as from `from_orbit` or `from_motion`, or a `CollocatedCycle`.
    degree : int
    intervals : int, optional
        Their number; where left out as many as the tolerance takes.
    most : int
        Largest number of intervals that is tried.
    tolerance : float
        Largest error of the period and of the states where intervals begin, both relative.
    stability : bool

    Returns
    -------
    CollocatedCycle

    Raises
    ------
    ConvergenceError
        When there is no cycle near the guess, or too many intervals would be needed.
    ModelError
        When an element jumps, or the system conserves a quantity; for a guess of another system or kind, or numbers
        that are not acceptable.
    """
    degree, tolerance = whole("collocated: degree", degree, 2), positive("tolerance", tolerance, "1")
    intervals = None if intervals is None else whole("collocated: intervals", intervals, 4)
    check_guess(system, guess)
    rates, solved, before = Rates(system), None, None
    N, failure, estimate = intervals or FIRST, "", np.inf
    while max(most, intervals or 0) >= N:
        try:
            equations, u = adapted(*solved, N) if solved else on_mesh(rates, guess.on(N, degree))
            before = equations.size if before is None else before
            equations, u, line = settled(equations, *newton(equations, u))
            for _ in range(0 if solved else ADAPTIONS):
                equations, u = adapted(equations, u, N)
                equations, u, line = settled(equations, *newton(equations, u))
            last, (errors, finer) = estimate, errors_of(equations, u)
            estimate = max(errors[:2])
            if intervals or estimate <= tolerance:
                break
            # a coarse mesh may have led to a solution that is none: begin again where more intervals do not help
            solved = (equations, u) if estimate < 0.5 * last else None
        except ConvergenceError as error:
            failure = str(error)
            if intervals:
                raise
        N *= 2
    else:
        raise ConvergenceError(
            f"{most} intervals of degree {degree} do not resolve the cycle to {tolerance:g}, the estimate is "
            f"{estimate:.2g}; give a larger tolerance."
            if np.isfinite(estimate)
            else failure
        )
    share = float((np.ptp(equations.unpack(u)[0], axis=(0, 1)) / before).max())
    if share < SHRUNK:
        raise ConvergenceError(
            f"system {system.name!r}: collocation did not end on a cycle, the motion has shrunk to {share:.2g} of the "
            "guess; there may be none near by."
        )
    if times := _repeats(equations, u):
        mesh, values = equations.mesh, equations.unpack(u)[0]
        once = Sampled(
            system,
            lambda s: evaluated(mesh, values, s / times),
            np.append(times * mesh[mesh < 1 / times], 1.0),
            float(np.exp(u[-2])) / times,
            dict(guess.parameters),
        )
        return collocated(
            system, once, degree=degree, intervals=intervals, most=most, tolerance=tolerance, stability=stability
        )
    judge = (spectrum_of(line), spectrum_of(finer), finer.transitions) if stability else None
    return finished(equations, u, _size(line), errors, judge, line.reduced is not None and line.reduced.family)


def _repeats(equations: OnMesh, u: Array) -> int:
    """Return how often a cycle passes through itself in its period, 2 or 3; 0 where it does not."""
    values, s = equations.unpack(u)[0], np.arange(SAMPLES) / SAMPLES
    x = evaluated(equations.mesh, values, s) / equations.size
    far = {k: float(np.abs(x - np.roll(x, SAMPLES // k, axis=0)).max()) for k in (2, 3)}
    return next((k for k, d in far.items() if d <= REPEATED), 0)


def finished(
    equations: OnMesh,
    u: Array,
    residual: float,
    errors: Errors,
    judge: tuple[Spectrum, Spectrum, Array | None] | None,
    family: bool = False,
) -> CollocatedCycle:
    """Return a solution as a cycle, with its stability where multipliers, and those of the next degree, are given."""
    system = equations.rates.system
    values, T, _ = equations.unpack(u)
    p = dict(zip(system.parameter_names, map(float, equations.parameters(u)), strict=True))
    status = (
        f"solved for by collocation on {equations.N} intervals; estimated error of the period {errors[0]:.1e}, "
        f"of the waveform {errors[2]:.1e}."
    )
    if family:
        status += " It is not isolated: one of a continuous family, as in a conservative system (or at a fold)."
    return replace(
        cycle_of(system, equations.mesh, values, T, p, equations.advance),
        residual=residual,
        period_error=errors[0],
        waveform_error=errors[2],
        stability=None if judge is None else stability_of(judge[0], judge[1], equations.size, judge[2]),
        status=status,
    )
