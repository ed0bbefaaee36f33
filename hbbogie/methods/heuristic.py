"""Heuristic stability of cycles found by equivalent linearisation (section 4.1 of the source).

For each element in turn, increase its amplitude a little. Its equivalent stiffness changes, and with it the critical
value of the parameter. If the actual value then lies on the stable side of the critical one, the oscillation decays and
the amplitude falls back. A cycle is called stable if this holds for every element. This is an argument about slowly
varying amplitudes of one harmonic and no proof. Use Floquet multipliers for a reliable verdict.

References
----------
Y.-R. Yang, Limit cycle hunting of a bogie with flanged wheels, Vehicle System Dynamics 24 (1995) 185-196.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hbbogie.brief import brief
from hbbogie.errors import ModelError, unknown_name
from hbbogie.methods.compatibility import Compatible, compatible
from hbbogie.methods.equivalent import EquivalentSystem, NeutralMode
from hbbogie.model.system import System
from hbbogie.results.failure import ConvergenceError

Array = NDArray[np.float64]
ANYWHERE = (-np.inf, np.inf)  # a guess replaces the interval


@dataclass(frozen=True, eq=False)
class Component:
    """The verdict of one element on the stability of a cycle.

    Attributes
    ----------
    element : str
    amplitude : float, unit of the argument
        Amplitude of its argument on the cycle.
    slope : float, unit of the parameter per unit of the argument
        Derivative of the critical value with respect to the amplitude, at the cycle.
    verdict : {"stable", "unstable", "neutral"}
        Neutral if the equivalent stiffness does not change, because there is no contact.
    amplitudes : ndarray, shape (points,), unit of the argument
    stiffness : ndarray, shape (points,), unit of force per unit of the argument
        Equivalent stiffness at each amplitude.
    critical : ndarray, shape (points,), unit of the parameter
        Critical value at each amplitude; NaN if there is none.
    """

    element: str
    amplitude: float
    slope: float
    verdict: str
    amplitudes: Array
    stiffness: Array
    critical: Array


@dataclass(frozen=True, eq=False)
class HeuristicStability:
    """Heuristic stability of a cycle.

    Attributes
    ----------
    verdict : {"stable", "unstable", "unknown"}
        Unknown if every element is neutral.
    parameter : str
    value : float
        Actual value of the parameter.
    components : tuple of Component
    others : {"follow", "held"}
    reason : str
        A sentence.
    """

    verdict: str
    parameter: str
    value: float
    components: tuple[Component, ...]
    others: str
    reason: str

    __repr__ = brief


def heuristic_stability(
    system: System,
    cycle: Compatible,
    *,
    others: str = "follow",
    step: float = 1e-5,
    span: tuple[float, float] = (0.9, 1.2),
    points: int = 13,
) -> HeuristicStability:
    """Judge a cycle element by element.

    Parameters
    ----------
    system : System
        The system to which the cycle belongs.
    cycle : Compatible
        As returned by `compatible`.
    others : {"follow", "held"}
        Whether the amplitudes of the other elements remain compatible or remain fixed.
    step : float
        Increase of the amplitude, relative to the amplitude.
    span : (float, float)
        Range of the curves, relative to the amplitude, about 1.
    points : int
        Number of points on the curves.

    Returns
    -------
    HeuristicStability

    Raises
    ------
    ModelError
        For another value of ``others``, or a span that does not contain the cycle.

    Notes
    -----
    Held amplitudes neglect the interaction of the elements. For Yang's bogie they give "unstable" for every cycle,
    because a stiffer front flange alone always lowers the critical speed. Amplitudes that follow give both wheelsets
    the same verdict, which depends on whether the speed falls or rises along the branch.
    """
    if others not in ("follow", "held"):
        raise ModelError(f"heuristic_stability: {unknown_name('others', others, ('follow', 'held'))}")
    if not 0 < span[0] < 1 < span[1]:
        raise ModelError(f"heuristic_stability: span={span!r}; give (low, high) with 0 < low < 1 < high.")
    equivalent = EquivalentSystem(system.with_parameters(**cycle.orbit.parameters), cycle.parameter)
    walk = _Walk(equivalent, cycle, others == "held")
    a = walk.inputs
    change = np.abs(equivalent.stiffening(a) * a)
    components = []
    for i, name in enumerate(equivalent.names):
        slope = (walk.critical(i, (1.0, 1 + step))[-1] - walk.known.value) / (step * a[i])
        stable = slope * walk.known.rise > 0
        neutral = change[i] <= 1e-9 * change.max()
        verdict = "neutral" if neutral else "stable" if stable else "unstable"
        factors = np.sort(np.append(np.linspace(*span, points - 1), 1.0))
        at = int(np.searchsorted(factors, 1.0))
        down, up = walk.critical(i, factors[: at + 1][::-1]), walk.critical(i, factors[at:])
        stiffness = np.array([walk.stiffness(i, f)[i] for f in factors])
        critical = np.r_[down[:0:-1], up]
        components.append(Component(name, float(a[i]), float(slope), verdict, a[i] * factors, stiffness, critical))
    verdict, reason = _verdict(components)
    return HeuristicStability(verdict, cycle.parameter, walk.known.value, tuple(components), others, reason)


class _Walk:
    """Critical values over the amplitude of one element, starting at a cycle."""

    def __init__(self, equivalent: EquivalentSystem, cycle: Compatible, held: bool):
        self.equivalent, self.cycle, self.held = equivalent, cycle, held
        self.inputs = np.array([cycle.amplitudes[name] for name in equivalent.names])
        self.known = equivalent.critical(equivalent.stiffness(self.inputs), cycle.value, cycle.omega)

    def stiffness(self, i: int, factor: float) -> Array:
        """Return the equivalent stiffnesses with the amplitude of element i changed by a factor, shape (m,)."""
        a = self.inputs.copy()
        a[i] *= factor
        return self.equivalent.stiffness(a)

    def critical(self, i: int, factors: Array | tuple[float, ...]) -> Array:
        """Return the critical value at each factor, starting from 1; NaN beyond the factor at which it is lost."""
        values = np.full(len(factors), np.nan)
        known: NeutralMode = self.known
        orbit, before = self.cycle.orbit, self.stiffness(i, 1.0)
        name = self.equivalent.names[i]
        for k, factor in enumerate(factors):
            try:
                if self.held:
                    after = self.stiffness(i, factor)
                    known, before = self.equivalent.follow(known, before, after), after
                    values[k] = known.value
                else:
                    target = {name: float(self.inputs[i] * factor)}
                    found = compatible(self.equivalent.system, target, self.cycle.parameter, ANYWHERE, guess=orbit)
                    values[k], orbit = found.value, found.orbit
            except ConvergenceError:
                break
        return values


def _verdict(components: list[Component]) -> tuple[str, str]:
    """Return the verdict of all elements together, and a sentence."""
    said = {v: [c.element for c in components if c.verdict == v] for v in ("stable", "unstable", "neutral")}
    parts = [f"{v} by {', '.join(names)}" for v, names in said.items() if names]
    verdict = "unstable" if said["unstable"] else "stable" if said["stable"] else "unknown"
    return verdict, "; ".join(parts)
