"""The summary of a report: sentences made from its numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from hbbogie.branches.diagram import Diagram
from hbbogie.critical.folds import Critical, fold
from hbbogie.equilibria.find import find_equilibria
from hbbogie.exact.method import Exact
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.model.system import System
from hbbogie.plot.curves import pieces
from hbbogie.results import Branch, Equilibria, Orbit
from hbbogie.results.failure import FAILURES
from hbbogie.units import behind, readable

RAISED = 0.1  # share by which a parameter is raised in a sentence on what it moves
FELT = 1e-3  # smallest elasticity worth a sentence
MOST = 3  # parameters named
NARROW = 1e-6  # share of the interval below which a span is none

Array = NDArray[np.float64]
Span = tuple[float, float]


def diagram_sentences(system: System, found: Diagram, rest: Equilibria | None = None) -> tuple[str, ...]:
    """Return what a bifurcation diagram says: where equilibrium and cycles are stable, alone and together.

    Parameters
    ----------
    system : System
    found : Diagram
    rest : Equilibria, optional
        Over the interval of the diagram; found where left out.
    """
    name, least = found.parameter, NARROW * (found.interval[1] - found.interval[0])
    rest = find_equilibria(system, name, found.interval) if rest is None else rest
    still = _joined(span for b in rest for span in _stable(b, rest_pieces(b, lambda o: 0.0)))
    cycles = _joined(span for b in found.branches.values() for span in _stable(b, pieces(b, lambda o: o.omega)))
    both = [s for s in _common(still, cycles) if s[1] - s[0] > least]
    said = [
        f"{_between(system, name, s)} a large disturbance starts oscillation, although the equilibrium is stable."
        for s in both
    ]
    for point in found.hopf:
        kind = next((s.criticality for b in found.branches.values() for s in b.special if _same(s, point)), "")
        beside = {
            "subcritical": ": the cycles that begin here are unstable, and stable ones are large at once",
            "supercritical": ": small stable cycles begin here",
        }.get(kind, "")
        said.append(f"The equilibrium has a Hopf point at {_at(system, name, point.value)}{beside}.")
    if cycles and (largest := _largest(system, found)):
        said.append(largest)
    lost = sum("No branch was traced" in note or note.startswith("Cycles at") for note in found.notes)
    if lost:
        said.append("Not all branches could be followed, and more may exist; the remarks say which and why.")
    if not found.branches and found.families:
        said.append("Cycles of every amplitude exist, as in a conservative system; a disturbance decides which.")
    elif not found.branches:
        said.append(f"No cycle was found {_between(system, name, found.interval).lower()}.")
    return tuple(said)


def whole_summary(system: System, found: Diagram, rest: Equilibria | None = None) -> tuple[str, ...]:
    """Return what a diagram says, with what moves its lowest fold; parameters as of `diagram_sentences`."""
    return (*diagram_sentences(system, found, rest), *influence_sentences(system, fold_of_diagram(system, found)))


def branches_sentences(system: System, branches: Mapping[str, Branch]) -> tuple[str, ...]:
    """Return what some branches over one parameter say, with what moves their lowest fold."""
    many = {name: b for name, b in branches.items() if len(b) > 1}
    if len({b.parameter for b in many.values()}) != 1:
        return ()
    values = np.concatenate([b.values for b in many.values()])
    hopf = {s.value: s for b in many.values() for s in b.special if s.kind == "hopf"}
    ends = float(values.min()), float(max(values.max(), max(hopf, default=-np.inf)))
    parameter = next(iter(many.values())).parameter
    found = Diagram(parameter, ends, list(hopf.values()), many, {}, [], ())
    return whole_summary(system, found)


def cycles_sentences(system: System, parameter: str, cycles: Sequence[Orbit]) -> tuple[str, ...]:
    """Return what the cycles at one value of the parameter say, the smallest first."""
    q = system.coordinate_names[0]
    at = _at(system, parameter, system.values[parameter])
    if not cycles:
        return (f"No cycle was found at {at}.",)
    said = [f"There {'is one cycle' if len(cycles) == 1 else f'are {len(cycles)} cycles'} at {at}."]
    for o in cycles:
        kind = {"stable": "stable", "unstable": "unstable"}.get(o.verdict, "not judged")
        beyond = {
            "stable": "motions near it end on it",
            "unstable": "motions near it leave it",
            "not judged": "whether motions near it stay is not known",
        }[kind]
        said.append(
            f"One is {kind}, with a peak of {o.peaks()[q]} of {system.naming.plain(q)} at {o.frequency:.4g} Hz: "
            f"{beyond}."
        )
    return tuple(said)


def influence_sentences(system: System, found: Sequence[Critical]) -> tuple[str, ...]:
    """Return what moves the lowest fold and the lowest Hopf point most, in their unit.

    Parameters
    ----------
    system : System
    found : sequence of Critical
        With gradients, by growing value.
    """
    said = []
    for kind in ("fold", "hopf"):
        first = next((c for c in found if c.kind == kind and c.gradient and c.value), None)
        if first is None:
            continue
        strong = sorted(first.elasticities, key=lambda n: -abs(first.elasticities[n]))[:MOST]
        factor, unit = readable(system.parameter(first.parameter).unit, abs(first.value))
        what = "Hopf point" if kind == "hopf" else "fold"
        moved = []
        for n in strong:
            if abs(first.elasticities[n]) <= FELT:
                continue
            change = _signed(factor * RAISED * first.elasticities[n] * first.value)
            by = f"by {change}{behind(unit)}"
            moved.append(f"{system.naming.plain(n)} by {RAISED * 100:.0f} % moves it {by}")
        if moved:
            begin = f"The {what} is at {_at(system, first.parameter, first.value)}. To first order, raising "
            said.append(f"{begin}{'; '.join(moved)}.")
    return tuple(said)


def fold_of_diagram(system: System, found: Diagram) -> list[Critical]:
    """Return the lowest fold of a diagram with its gradient, or nothing where there is none."""
    folds = sorted((s for b in found.branches.values() for s in b.folds() if s.resolved), key=lambda s: s.value)
    for point in folds[:1]:
        exact = point.orbit.method == "exact"
        method = Exact() if exact else HarmonicBalance(point.orbit.H)
        try:
            return [fold(method.equations(system), point, found.parameter)]
        except FAILURES:
            return []
    return []


# --- words --------------------------------------------------------------------------------------


def _largest(system: System, found: Diagram) -> str:
    """Return a sentence on the largest stable cycle."""
    q = system.coordinate_names[0]
    stable = [o for b in found.branches.values() for o in b if o.verdict == "stable"]
    if not stable:
        return ""
    top = max(stable, key=lambda o: o.amplitude(q))
    return (
        f"The largest stable cycle found, at {_at(system, found.parameter, top.parameters[found.parameter])}, has a "
        f"peak of {top.peaks()[q]} of {system.naming.plain(q)} and a frequency of {top.frequency:.3g} Hz."
    )


def _at(system: System, name: str, value: float, digits: int = 4) -> str:
    return f"{name} = {_number(system, name, value, digits)}"


def _number(system: System, name: str, value: float, digits: int = 4) -> str:
    """Return a value with its unit."""
    factor, unit = readable(system.parameter(name).unit, abs(value))
    return f"{factor * value + 0.0:.{digits}g}{behind(unit)}"


def _between(system: System, name: str, span: Span) -> str:
    low, high = (float(f"{v:.4g}") for v in span)
    return f"Between {name} = {low:g} and {_number(system, name, high)}"


def _signed(value: float) -> str:
    return f"{value:+.2g}".replace("-", "\N{MINUS SIGN}")


# --- spans of the parameter ---------------------------------------------------------------------


def rest_pieces(branch: Branch, height: Callable[[Orbit], float]) -> list[tuple[str, Array]]:
    """Return a branch of equilibria as lines of one verdict each, which meet at its special points.

    Parameters
    ----------
    branch : Branch
        Of orbits with H = 0.
    height : callable
        `Orbit` -> what is drawn over the parameter.

    Returns
    -------
    list of (str, ndarray, shape (k, 2))
    """
    values, told = branch.values, branch.verdicts
    points = [(float(v), height(o)) for v, o in zip(values, branch, strict=True)]
    found = [(told[0], points[:1])]
    for i in range(1, len(points)):
        if told[i] != told[i - 1]:
            low, high = sorted((values[i - 1], values[i]))
            between = [s for s in branch.special if low <= s.value <= high]
            middle = [(s.value, height(s.orbit.replace(coefficients=s.orbit.coefficients[:1]))) for s in between[:1]]
            edge = middle or [tuple(np.mean(points[i - 1 : i + 1], axis=0))]
            found[-1][1].extend(edge)
            found.append((told[i], list(edge)))
        found[-1][1].append(points[i])
    return [(verdict, np.array(line)) for verdict, line in found]


def _stable(branch: Branch, curves: Iterable[tuple[str, Array]]) -> Iterator[Span]:
    """Give the spans of the stable ones of a branch's curves; between its points a curve may reach a little further."""
    low, high = float(branch.values.min()), float(branch.values.max())
    for verdict, c in curves:
        if verdict == "stable":
            yield max(low, float(c[:, 0].min())), min(high, float(c[:, 0].max()))


def _joined(spans: Iterable[Span]) -> list[Span]:
    """Return spans that do not overlap, in order."""
    kept: list[Span] = []
    for low, high in sorted(spans):
        if kept and low <= kept[-1][1]:
            kept[-1] = kept[-1][0], max(high, kept[-1][1])
        else:
            kept.append((low, high))
    return kept


def _common(first: Sequence[Span], second: Sequence[Span]) -> list[Span]:
    pairs = ((max(a[0], b[0]), min(a[1], b[1])) for a in first for b in second)
    return [(low, high) for low, high in pairs if low < high]


def _same(one: object, other: object) -> bool:
    keys = ("kind", "value")
    return all(getattr(one, k) == getattr(other, k) for k in keys)
