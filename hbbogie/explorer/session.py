"""A session: a problem, and the diagrams computed last, so that a click needs no second computation."""

from __future__ import annotations

import threading
from collections import OrderedDict
from dataclasses import replace
from itertools import zip_longest
from math import isfinite
from types import ModuleType
from typing import Any

from hbbogie.errors import ModelError, as_number
from hbbogie.exact.method import ExactEquations
from hbbogie.explorer.following import Explored, check_explorable, equations_of, explored
from hbbogie.explorer.picture import cycle_at, cycle_data, diagram_data
from hbbogie.explorer.script import script_of
from hbbogie.explorer.view import View, reach_of, view_of
from hbbogie.model.problem import system_of
from hbbogie.model.system import System
from hbbogie.reports.cycles import report_of_diagram
from hbbogie.reports.page import Origin, html_of
from hbbogie.reports.table import Table, plain
from hbbogie.units import behind, label

KEPT = 8  # diagrams


class Session:
    """What the page asks, answered as plain data. Questions are answered one after the other.

    Parameters
    ----------
    problem : str
        Name or path.
    module : module
        As returned by `load_problem`.
    system : System
        At the values with which the session begins.
    first : View

    Raises
    ------
    ModelError
        For a system whose diagram would take minutes.
    """

    def __init__(self, problem: str, module: ModuleType, system: System, first: View):
        check_explorable(system)
        self.problem, self.module, self.system, self.first = problem, module, system, first
        self._known: OrderedDict[str, Explored] = OrderedDict()
        self._turn = threading.Lock()

    def opening(self) -> dict[str, Any]:
        """Return what the page must know before its first diagram: parameters, coordinates, the first view."""
        parameters = []
        for p in self.system.parameters:
            value = self.system.values[p.name]
            low, high = reach_of(p, value)
            own = {"name": p.name, "text": p.description, "unit": p.unit, "value": value, "low": low, "high": high}
            parameters.append({**own, "least": p.bounds[0], "most": p.bounds[1]})
        idle = set(self.system.inactive_parameters)
        naming = self.system.naming
        drawn = (*self.system.coordinate_names, *self.system.output_names)
        coordinates = [{"name": n, "text": naming.descriptions.get(n, ""), "unit": naming.units[n]} for n in drawn]
        exact = isinstance(equations_of(self.system), ExactEquations)
        said = (
            "Cycles in closed form: every move of a slider is answered at once."
            if exact
            else "Cycles by harmonic balance, followed from those before: a move of a slider may take some seconds."
        )
        about = (self.module.__doc__ or "").strip().partition("\n")[0]
        content = {"system": self.system.name, "about": about, "problem": self.problem, "said": said}
        shown = [p for p in parameters if p["name"] not in idle]
        return plain({**content, "parameters": shown, "coordinates": coordinates, "view": self.first.as_dict()})  # type: ignore[no-any-return]

    def diagram(self, question: Any) -> dict[str, Any]:
        """Return the diagram at a view; with ``"anew": true`` cycles are searched from nothing."""
        anew = bool(isinstance(question, dict) and question.get("anew"))
        return diagram_data(self._explored(question, anew))

    def cycle(self, question: Any) -> dict[str, Any]:
        """Return the cycle of a ``branch`` at a place ``x``, ``y`` of the drawn diagram."""
        found = self._explored(question)
        x, y = (as_number(question.get(key)) for key in ("x", "y"))
        if not (isfinite(x) and isfinite(y)):
            raise ModelError("Which cycle is meant? Give a branch, and numbers x and y of a place on it.")
        with self._turn:
            orbit = cycle_at(found, str(question.get("branch")), x, y)
            return cycle_data(found, orbit, self.module)

    def script(self, question: Any) -> dict[str, str]:
        """Return the session as a script, under ``"text"``."""
        found, pinned = self._both(question)
        return {"text": script_of(self.problem, found, system_of(self.module).values, pinned)}

    def report(self, question: Any) -> dict[str, str]:
        """Return the session as a page that can be handed on, under ``"text"``."""
        found, pinned = self._both(question)
        own = system_of(self.module).values
        report = report_of_diagram(found.system, found.diagram, found.equilibria)
        if pinned is not None:
            report = replace(report, tables=(_beside(found, pinned), *report.tables))
        again = script_of(self.problem, found, own, pinned)
        with self._turn:
            return {"text": html_of(report, Origin(found.system, dict(own), again))}

    def _both(self, question: Any) -> tuple[Explored, Explored | None]:
        """Return the diagram that is shown and the pinned one, where there is one."""
        pinned = question.get("pinned")
        return self._explored(question), self._explored({"view": pinned}) if pinned else None

    def _explored(self, question: Any, anew: bool = False) -> Explored:
        view = view_of(self.system, question.get("view") if isinstance(question, dict) else None)
        key = repr(view)
        with self._turn:
            if key in self._known and not anew:
                self._known.move_to_end(key)
                return self._known[key]
            before = None if anew else next(reversed(self._known.values()), None)
            self._known[key] = found = explored(self.system, view, before)
            self._known.move_to_end(key)
            while len(self._known) > KEPT:
                self._known.popitem(last=False)
            return found


def _beside(found: Explored, pinned: Explored) -> Table:
    """Return the special points of a diagram beside those of the pinned one, by kind, and what differs."""
    name, unit = found.view.parameter, found.system.parameter(found.view.parameter).unit
    rows = []
    for kind in ("hopf", "fold"):
        here, there = (_values(one, kind) for one in (found, pinned))
        for now, before in zip_longest(here, there):
            change = now - before if now is not None and before is not None else None
            rows.append(("Hopf point" if kind == "hopf" else kind, before, now, change))
    differ = [
        f"{n}: {pinned.system.values[n]:.6g} pinned, {v:.6g} now{behind(found.system.parameter(n).unit)}."
        for n, v in found.system.values.items()
        if v != pinned.system.values[n]
    ]
    columns = ("special point", *(label(f"{name} {when}", unit) for when in ("pinned", "now")), label("change", unit))
    return Table("beside", "Beside the pinned", columns, tuple(rows), ("", ".6g", ".6g", "+.4g"), tuple(differ))


def _values(found: Explored, kind: str) -> list[float]:
    points = found.diagram.hopf if kind == "hopf" else [s for b in found.curves.values() for s in b.folds()]
    return sorted(s.value for s in points)
