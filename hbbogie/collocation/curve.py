"""The curve of collocated cycles over a parameter on one mesh, as `hbbogie.solving.arclength` follows it."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from hbbogie.collocation.equations import Linearised, OnMesh
from hbbogie.collocation.multipliers import Spectrum, spectrum_of
from hbbogie.collocation.solving import Errors, errors_of
from hbbogie.equilibria.resting import at_rest, resting_place
from hbbogie.model.system import System
from hbbogie.polynomials import moved
from hbbogie.results.ending import Ending
from hbbogie.solving.curve import Point

Array = NDArray[np.float64]
VANISHED = 1e-3  # amplitude, relative to the largest of the branch, at which a cycle counts as an equilibrium
ROUND_OFF = 1e-12  # share of the parameter's scale up to which it is zero
PREDICTED = 10.0  # tolerance of predicted points: those on a tangent with a residual up to 1e-3 are not corrected
NEAR = 1e-2  # distance from an equilibrium, relative to the range, at which a motion is near it
RESTING = 0.9  # share of the period spent there by a motion that approaches a homoclinic one


class OnMeshCurve:
    """Cycles over a parameter on one mesh, see `hbbogie.solving.curve.Curve`.

    Parameters
    ----------
    equations : OnMesh
        With a parameter.
    interval : (float, float), unit of the parameter
    longest : float, s
        Period at which the curve ends.
    largest : ndarray, shape (n_states,)
        Ranges of the largest cycle of the branch.
    tolerance : float
    """

    def __init__(
        self, equations: OnMesh, interval: tuple[float, float], longest: float, largest: Array, tolerance: float
    ):
        self.equations, self.interval, self.longest, self.largest = equations, interval, longest, largest
        self.scale, self.weights, self.tolerance = equations.scale, equations.weights, tolerance
        last = len(self.scale) - 1
        self.window = {last: interval, last - 1: (-np.inf, float(np.log(longest)))}
        self._last: tuple[Array, Linearised] | None = None
        self._spectra: dict[int, tuple[Array, Spectrum]] = {}
        self._estimates: dict[int, tuple[Array, Errors, Spectrum]] = {}

    def predicting(self) -> OnMeshCurve:
        """Return the curve for steps to points that are settled on their own contact times next, if there are any."""
        if not self.equations.rates.kinked:
            return self
        there = copy(self)
        there.tolerance = PREDICTED
        return there

    @property
    def parameter(self) -> str:
        """Name of the parameter."""
        assert self.equations.rates.parameter is not None
        return self.equations.rates.parameter

    def linearise(self, u: Array) -> Linearised:
        """Return the equations and their derivative."""
        line = self.equations.linearise(u)
        self._last = u, line
        return line

    def settle(self, u: Array) -> None:
        """Take the phase from the last point, and its multipliers from the last factorisation."""
        if self._last is not None and self._last[0] is u and self._last[1].reduced is not None:
            self._spectra[id(u)] = u, spectrum_of(self._last[1])
        self.equations = self.equations.at_phase(u)

    def deviation(self, u: Array) -> Array:
        """Return the stages less their means, scaled, with the roots of their weights, shape (N, m, n)."""
        e = self.equations
        stages = e.unpack(u)[0][:, 1:] / e.size
        mean = np.einsum("ij,ijn->n", e.measure, stages)
        return np.asarray((stages - mean) * np.sqrt(e.measure)[..., None])

    def leaves(self, points: Sequence[Point], there: Point) -> Ending | None:
        """Return why the branch ends before a point: the cycle shrinks to an equilibrium."""
        here, beyond = self.deviation(points[-1].u), self.deviation(there.u)
        ranges = np.ptp(self.equations.unpack(there.u)[0], axis=(0, 1))
        if (here * beyond).sum() <= 0 or (ranges <= VANISHED * self.largest).all():
            return Ending("vanishes", f"the cycle shrinks to an equilibrium at {self.where(points[-1].u)}")
        return None

    def at(self, index: int, value: float) -> Ending:
        """Return the ending at a limit of the parameter or of the period."""
        if index == len(self.scale) - 1:
            return Ending("interval", f"the end of the interval was reached, {self.parameter} = {value:.6g}")
        return Ending("period", f"the period has grown to {np.exp(value):.4g} s")

    def where(self, u: Array) -> str:
        """Return the parameter's value, for people."""
        return f"{self.parameter} = {0.0 if abs(u[-1]) <= ROUND_OFF * self.equations.width else u[-1]:.10g}"

    def line(self, point: Point) -> Linearised:
        """Return the equations at a point, solved once, bordered by the tangent."""
        line = self.equations.at_phase(point.u).linearise(point.u)
        line.solve(self.weights * point.tangent, np.append(np.zeros(len(point.u) - 1), 1.0))
        return line

    def spectrum(self, point: Point) -> Spectrum:
        """Return the multipliers at a point."""
        if id(point.u) not in self._spectra:
            self._spectra[id(point.u)] = point.u, spectrum_of(self.line(point))
        return self._spectra[id(point.u)][1]

    def estimate(self, point: Point) -> tuple[Errors, Spectrum]:
        """Return the errors of a point, see `errors_of`, and the multipliers of the next degree."""
        if id(point.u) not in self._estimates:
            errors, finer = errors_of(self.equations, point.u, lifted(self.equations, point.tangent))
            self._estimates[id(point.u)] = point.u, errors, spectrum_of(finer)
        return self._estimates[id(point.u)][1:]

    def value(self, kind: str, point: Point) -> float:
        """Return a test function of a point, which changes its sign where something happens.

        Parameters
        ----------
        kind : {"fold", "branch point", "period doubling", "Neimark-Sacker"}
        point : Point
        """
        if kind == "fold":
            return float(point.tangent[-1])
        spectrum = self.spectrum(point)
        if kind == "branch point":
            # that of the walk may belong to the tangent turned
            return abs(spectrum.singular) * point.orientation
        values = spectrum.others
        if len(values) == 1:
            return 1.0  # it is positive, by Liouville's formula
        with np.errstate(invalid="ignore", over="ignore"):
            factors = values if kind == "period doubling" else np.array([a * b for a, b in combinations(values, 2)])
            off = factors + 1 if kind == "period doubling" else factors - 1
            product = np.prod(off / np.maximum(1.0, np.abs(factors)))
        return float(np.nan_to_num(product.real, nan=1.0)) if len(factors) else 1.0


def lifted(equations: OnMesh, tangent: Array, mesh: Array | None = None, m: int | None = None) -> Array:
    """Return the row that belongs to a tangent on another mesh, of the next degree where no other is given."""
    degree = equations.m + 1 if m is None else m
    there = replace(equations, mesh=equations.mesh if mesh is None else mesh, m=degree)
    k = equations.N * equations.m * equations.n
    stages, states = tangent[:k].reshape(equations.N, equations.m, -1), tangent[k:-2].reshape(equations.N, 1, -1)
    values = moved(equations.mesh, np.concatenate([states, stages], axis=1), there.mesh, degree)
    return there.weights * np.concatenate([values[:, 1:].ravel(), values[:, 0].ravel(), tangent[-2:]])


def homoclinic(system: System, equations: OnMesh, u: Array) -> str:
    """Return the equilibrium near which a cycle of long period rests, for people; nothing where there is none."""
    values = equations.unpack(u)[0]
    x = resting_place(system, values[:, 0], equations.parameters(u), equations.size)
    if x is None:
        return ""
    off = values[:, 1:] - x
    if equations.advance:  # a turn away it is the same equilibrium
        turns = np.append(equations.advance, np.zeros(len(x) - system.n))
        off -= turns * np.round(off / np.where(turns, turns, np.inf))
        x = x - turns * np.round(x / np.where(turns, turns, np.inf))
    far = np.abs(off / equations.size).max(axis=2)
    return at_rest(system, x) if float(equations.measure[far <= NEAR].sum()) >= RESTING else ""
