"""The points of a study file (TOML), with checks and messages about errors in such a file."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from hbbogie.errors import ModelError, unknown_name
from hbbogie.model.system import System
from hbbogie.studies import sampling
from hbbogie.studies.distributions import Scaled, named_distribution
from hbbogie.studies.sampling import Points
from hbbogie.units import unit_factor

# sample -> keys besides it
SAMPLES: dict[str, tuple[str, ...]] = {
    "grid": ("parameters",),
    "list": ("rows",),
    "csv": ("file",),
    **dict.fromkeys(sampling.METHODS, ("count", "seed", "around", "except", "parameters")),
}


class PointsReader:
    """Turns the table ``[points]`` of a study file into points, and whatever is wrong with it into a sentence."""

    def __init__(self, path: Path, text: str):
        self.path, self.lines = path, text.splitlines()

    def wrong(self, table: str, key: str, message: str) -> NoReturn:
        """Raise the error of a key, with its line where that is found."""
        here, line = "", 0
        for i, content in enumerate(self.lines, 1):
            if header := re.match(r"\s*\[\[?\s*([^\]]+?)\s*\]\]?\s*(#.*)?$", content):
                here = header[1].replace('"', "")
                line = line or (i if here == table else 0)
            elif here == table and re.match(rf'\s*"?{re.escape(key)}"?\s*=', content):
                line = i
                break
        place = f", line {line}" if line else ""
        name = f"[{table}] {key}".rstrip() if table else key
        raise ModelError(f"{self.path}{place}: {name}: {message}")

    def take(
        self, content: Mapping[str, Any], table: str, key: str, kind: type | tuple[type, ...], default: Any
    ) -> Any:
        """Return the value of a key, of a type; the default where it is missing, an error where that is None."""
        if key not in content:
            if default is None:
                self.wrong(table, key, "is missing.")
            return default
        value = content[key]
        if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
            names = " or ".join(k.__name__ for k in (kind if isinstance(kind, tuple) else (kind,)))
            self.wrong(table, key, f"got {value!r}; give a value of type {names}.")
        return value

    def known(self, content: Mapping[str, Any], table: str, allowed: tuple[str, ...]) -> None:
        """Raise the error of a key of a table that is not allowed there."""
        for key in content:
            if key not in allowed:
                self.wrong(table, key, unknown_name("key", key, allowed))

    def beside(self, file: str) -> Path:
        """Return a path, relative to the study file."""
        path = Path(file).expanduser()
        return (self.path.parent / path).resolve()

    def numbers(self, table: str, key: str, given: Any) -> list[float]:
        """Return a number or a list of numbers as a list."""
        found = given if isinstance(given, list) else [given]
        if not all(isinstance(v, int | float) and not isinstance(v, bool) for v in found):
            self.wrong(table, key, f"got {given!r}; give a number or a list of numbers.")
        return [float(v) for v in found]

    def points(self, content: Mapping[str, Any], system: System, count: int | None) -> Points:
        """Return the points of the table; ``count`` of them where that is given."""
        everything = dict.fromkeys(("sample", *(key for keys in SAMPLES.values() for key in keys)))
        self.known(content, "points", tuple(everything))
        sample = self.take(content, "points", "sample", str, None)
        if sample not in SAMPLES:
            self.wrong("points", "sample", unknown_name("sample", sample, SAMPLES))
        for key in content:
            if key not in ("sample", *SAMPLES[sample]):
                place = ("points.parameters", "") if key == "parameters" else ("points", key)
                self.wrong(
                    *place, f"sample = {sample!r} has no such key; allowed besides it: {', '.join(SAMPLES[sample])}."
                )
        if "except" in content and "around" not in content:
            self.wrong("points", "except", "names what 'around' leaves out; give around = 0.1 or such, too.")
        given = self.take(content, "points", "parameters", dict, {})
        for name in given:
            if name not in system.parameter_names:
                self.wrong("points.parameters", name, unknown_name("parameter", name, system.parameter_names))
        try:
            return self._made(sample, content, given, system, count).of_system(system)
        except ModelError as error:
            if str(self.path) in str(error):
                raise
            self.wrong("points", "sample", str(error))

    def _made(
        self, sample: str, content: Mapping[str, Any], given: Mapping[str, Any], system: System, count: int | None
    ) -> Points:
        if sample == "grid":
            return _thinned({n: self.axis(n, v, system) for n, v in given.items()}, count)
        if sample == "list":
            return sampling.listed(self.take(content, "points", "rows", list, None)[:count])
        if sample == "csv":
            points = sampling.from_csv(self.beside(self.take(content, "points", "file", str, None)))
            return replace(points, values=points.values[:count])
        number = self.take(content, "points", "count", int, None)
        if count is not None:
            number = 2 ** int(np.log2(count)) if sample == "saltelli" else count
        ranges: dict[str, Any] = {}
        if "around" in content:
            share = self.take(content, "points", "around", (int, float), None)
            left_out = [*self.take(content, "points", "except", list, []), *given]
            for name in left_out:
                if name not in system.parameter_names:
                    self.wrong("points", "except", unknown_name("parameter", str(name), system.parameter_names))
            ranges |= {n: r for n, r in sampling.around(system, share).items() if n not in left_out}
        ranges |= {n: self.range(n, v, system) for n, v in given.items()}
        return sampling.METHODS[sample](ranges, number, self.take(content, "points", "seed", int, 0))

    def axis(self, name: str, given: Any, system: System) -> list[float]:
        """Return the values of a parameter of a grid: a list, or low, high and count."""
        if isinstance(given, list):
            return self.numbers("points.parameters", name, given)
        if not isinstance(given, dict):
            self.wrong("points.parameters", name, f"got {given!r}; give a list, or {{ low, high, count }}.")
        self.only(name, given, ("low", "high", "count", "unit"))
        low, high = (self.take(given, "points.parameters", key, (int, float), None) for key in ("low", "high"))
        factor = self.factor(name, given, system)
        number = self.take(given, "points.parameters", "count", int, None)
        if number < 1:
            self.wrong("points.parameters", name, f"count = {number}; give a whole number of at least 1.")
        return list(factor * np.linspace(low, high, number))

    def range(self, name: str, given: Any, system: System) -> Any:
        """Return the distribution of a parameter: low and high, around, or a named distribution with its values."""
        if not isinstance(given, dict):
            self.wrong("points.parameters", name, f"got {given!r}; give a table such as {{ low = 1, high = 2 }}.")
        if "around" in given:
            self.only(name, given, ("around",))
            self.take(given, "points.parameters", "around", (int, float), None)
            return sampling.around(system, float(given["around"]), [name])[name]
        values = {k: v for k, v in given.items() if k not in ("distribution", "unit")}
        for key, value in values.items():
            if not isinstance(value, int | float) or isinstance(value, bool):
                self.wrong("points.parameters", name, f"{key} = {value!r}; give a number.")
        factor = self.factor(name, given, system)
        kind = given.get("distribution", "uniform")
        try:
            frozen = named_distribution(kind, values)
        except ModelError as error:
            self.wrong("points.parameters", name, str(error))
        return frozen if factor == 1.0 else Scaled(frozen, factor)

    def only(self, name: str, given: Mapping[str, Any], allowed: tuple[str, ...]) -> None:
        """Raise the error of a key of a parameter's table that is not allowed there."""
        for key in given:
            if key not in allowed:
                self.wrong("points.parameters", name, unknown_name("key", key, allowed))

    def factor(self, name: str, given: Mapping[str, Any], system: System) -> float:
        """Return by what to multiply the values of a parameter."""
        own = system.parameter(name).unit
        try:
            return unit_factor(str(given.get("unit", own)), own, name)
        except ModelError as error:
            self.wrong("points.parameters", name, str(error))


def _thinned(axes: Mapping[str, list[float]], count: int | None) -> Points:
    """Return a grid, of about ``count`` points with the same ends where that is asked for."""
    if count is not None and axes:
        total = float(np.prod([len(v) for v in axes.values()]))
        share = min(1.0, count / total) ** (1 / len(axes))
        kept = {n: max(min(2, len(v)), round(share * len(v))) for n, v in axes.items()}
        axes = {n: [v[i] for i in np.linspace(0, len(v) - 1, kept[n]).round().astype(int)] for n, v in axes.items()}
    return sampling.grid(axes)
