"""What a session shows: the parameter on the axis, its interval, what is drawn over it, and all parameter values."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import ModuleType
from typing import Any

from hbbogie.errors import ModelError, named
from hbbogie.model.problem import default_interval
from hbbogie.model.ranges import check_interval
from hbbogie.model.symbols import Parameter
from hbbogie.model.system import System
from hbbogie.units import unit_factor

REACH = 0.5  # share of its value to which a slider reaches to either side


@dataclass(frozen=True)
class View:
    """What a session shows.

    Attributes
    ----------
    parameter : str
        On the axis.
    interval : (float, float), unit of that parameter
    coordinate : str
        Coordinate or output whose peak is drawn.
    values : dict of float
        Value of every parameter, in its own unit; that on the axis is where cycles are looked for at first.
    """

    parameter: str
    interval: tuple[float, float]
    coordinate: str
    values: Mapping[str, float]

    def as_dict(self) -> dict[str, Any]:
        """Return the view for JSON, as `view_of` reads it."""
        low, high = self.interval
        about = {"parameter": self.parameter, "low": low, "high": high, "coordinate": self.coordinate}
        return {**about, "values": dict(self.values)}


class Mistakes(ModelError):
    """What is wrong with a view.

    Attributes
    ----------
    fields : dict of str
        A sentence for each field of the page: a parameter, or "parameter", "low", "high", "coordinate".
    """

    def __init__(self, fields: Mapping[str, str]):
        super().__init__(" ".join(fields.values()))
        self.fields = dict(fields)


def opening(module: ModuleType, system: System, parameter: str | None = None, *interval: float) -> View:
    """Return the view with which a session begins: the problem's own parameter and range where nothing is said.

    Parameters
    ----------
    module : module
        As returned by `load_problem`.
    system : System
    parameter : str, optional
    *interval : float, unit of the parameter
        Its ends.

    Raises
    ------
    ModelError
        For an unknown parameter or an empty interval.
    """
    name, own = default_interval(module, system, parameter)
    low, high = check_interval(system, name, interval or own)  # type: ignore[arg-type]
    return View(name, (low, high), system.coordinate_names[0], dict(system.values))


def view_of(system: System, given: Any) -> View:
    """Return the view that a page asks for.

    Parameters
    ----------
    system : System
        Its values apply where the page gives none.
    given : mapping
        As `View.as_dict` returns it; numbers may be texts with a unit, such as "324 km/h".

    Raises
    ------
    Mistakes
        With a sentence for each field that is wrong.
    """
    given = given if isinstance(given, Mapping) else {}
    wrong: dict[str, str] = {}

    def read(field: str, job: Callable[..., Any], *args: Any) -> Any:
        try:
            return job(*args)
        except ModelError as error:
            wrong[field] = str(error)
            return None

    where = f"system {system.name!r}"
    name = read("parameter", named, where, "parameter", given.get("parameter"), system.parameter_names)
    drawn = (*system.coordinate_names, *system.output_names)
    coordinate = read("coordinate", named, where, "coordinate or output", given.get("coordinate"), drawn)
    values, numbers = given.get("values"), dict(system.values)
    for key, text in (values if isinstance(values, Mapping) else {}).items():
        numbers[key] = read(key, _value, system, key, text)
    ends = [0.0, 0.0]
    if name is not None:
        for i, field in enumerate(("low", "high")):
            ends[i] = read(field, _number, system.parameter(name), given.get(field))
        if not wrong.keys() & {"low", "high"}:
            ends = read("high", check_interval, system, name, (ends[0], ends[1]))
    if wrong:
        raise Mistakes(wrong)
    return View(name, (ends[0], ends[1]), coordinate, numbers)


def _value(system: System, name: str, text: Any) -> float:
    """Return the value of a parameter within its bounds."""
    number = _number(system.parameter(name), text)
    return system.with_parameters(**{name: number}).values[name]


def _number(parameter: Parameter, text: Any) -> float:
    """Return a number in the unit of a parameter; raise `ModelError` for anything else."""
    if isinstance(text, int | float) and not isinstance(text, bool):
        return float(text)
    number, _, unit = str("" if text is None else text).strip().partition(" ")
    try:
        value = float(number)
    except ValueError:
        raise ModelError(f"{text!r} is not a number; write one like 2.5e6, or with a unit like 2.5 kN/m.") from None
    return value * unit_factor(unit.strip(), parameter.unit, parameter.name) if unit.strip() else value


def reach_of(parameter: Parameter, value: float) -> tuple[float, float]:
    """Return the ends of the slider of a parameter: half its value to either side, 1 about 0, within its bounds."""
    width = REACH * abs(value) or 1.0
    low, high = parameter.bounds
    return max(value - width, low), min(value + width, high)
