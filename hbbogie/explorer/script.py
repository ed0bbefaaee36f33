"""A session as a script that computes and draws what it shows."""

from __future__ import annotations

from collections.abc import Mapping

from hbbogie.exact.method import ExactEquations
from hbbogie.explorer.following import HARMONICS, Explored

TEXT = '''"""{system}: the bifurcation diagram of a session of hbbogie explore."""

import hbbogie as hb
from hbbogie import plot

problem = hb.load_problem({problem!r})
parameter, interval = {parameter!r}, {interval!r}
designs = {{  # what differs from the problem's own values
{designs}
}}

curves, labels = [], []
for name, values in designs.items():
    system = hb.model.system_of(problem, **values)
{search}
    for branch in branches:
        print(name, branch)
        curves.append(branch)
        labels.append(name)

ax = plot.branch(curves, y={coordinate!r}, labels=labels if len(designs) > 1 else None)
plot.save(ax, "diagram.png")
print("Written: diagram.png")
'''
CLOSED = """    equations = hb.exact.Exact().equations(system)
    hopf = hb.hopf_points(system, parameter, interval)
    branches = [hb.trace(equations, point, parameter, interval) for point in hopf]"""
BALANCE = """    found = hb.branches.bifurcation_diagram(system, parameter, interval, harmonics={harmonics})
    branches = [*found.branches.values(), *found.families.values()]"""


def script_of(problem: str, found: Explored, own: Mapping[str, float], pinned: Explored | None = None) -> str:
    """Return a script that computes and draws a diagram, and beside it a pinned one.

    Parameters
    ----------
    problem : str
        Name or path, as `load_problem` takes it.
    found : Explored
    own : mapping from name to float
        The values that need not be written: those of the problem itself.
    pinned : Explored, optional
    """
    shown = {"now": found} | ({"pinned": pinned} if pinned is not None else {})
    rows = []
    for name, one in shown.items():
        changed = {n: v for n, v in one.system.values.items() if v != own.get(n)}
        rows.append(f"    {name!r}: {changed!r},")
    born = all(any(s.kind == "hopf" for s in b.special) for b in found.diagram.branches.values())
    closed = isinstance(found.equations, ExactEquations) and born
    return TEXT.format(
        system=found.system.name,
        problem=problem,
        parameter=found.view.parameter,
        interval=found.view.interval,
        coordinate=found.view.coordinate,
        designs="\n".join(rows),
        search=CLOSED if closed else BALANCE.format(harmonics=HARMONICS),
    )
