"""Study files (TOML): problem, job, points, outputs and figures of a study, checked before anything runs."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from hbbogie.errors import ModelError, unknown_name
from hbbogie.problem import shipped_folder, shipped_problems
from hbbogie.studies import sampling
from hbbogie.studies.distributions import Scaled, named_distribution, unit_factor
from hbbogie.studies.jobs import JOBS, job_function, wrong_option
from hbbogie.studies.sampling import Points
from hbbogie.studies.store import is_store
from hbbogie.studies.sweep import task_of
from hbbogie.system import System

KEYS = {
    "": ("title", "problem", "job", "outputs", "values", "options", "points", "figures"),
    "points": ("sample", "count", "seed", "around", "except", "rows", "file", "parameters"),
}
SAMPLES = ("grid", "list", "csv", *sampling.METHODS)
# kind -> keys that it needs, keys that it may have
FIGURES: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "map": (("x", "y", "output"), ()),
    "distribution": (("output",), ("below", "above")),
    "sensitivity": (("output",), ()),
    "scatter": (("x", "y"), ("colour",)),
    "parallel": (("output",), ("inputs",)),
    "prediction": (("output",), ()),
}


@dataclass(frozen=True, eq=False)
class Study:
    """What a study file asks for.

    Attributes
    ----------
    path : Path
    title : str
    problem : str
        Name of a shipped problem, or path.
    job : str
        Name of a job, or "path:function".
    values, options : dict
        Parameter values common to all points; keywords of the job.
    points : Points
    outputs : tuple of str
        Shown in the report; all of them where empty.
    figures : tuple of dict
        Of each figure its ``kind`` and the names it draws.
    """

    path: Path
    title: str
    problem: str
    job: str
    values: dict[str, Any]
    options: dict[str, Any]
    points: Points
    outputs: tuple[str, ...]
    figures: tuple[dict[str, Any], ...]


def shipped_studies() -> dict[str, Path]:
    """Return the studies that come with the package, by name."""
    return {p.stem: p for p in sorted((shipped_folder() / "studies").glob("*.toml"))}


def find_study(name_or_path: str | Path) -> Path:
    """Return the path of a study file, or of a shipped study by its name; raise `ModelError` where there is none."""
    path = Path(name_or_path)
    if path.is_file():
        return path
    shipped = shipped_studies()
    if str(name_or_path) in shipped:
        return shipped[str(name_or_path)]
    if path.suffix or len(path.parts) > 1:
        raise ModelError(
            f"no study file {str(path)!r} (looked for {str(path.absolute())!r}); give the path of one, or one of the "
            f"shipped studies: {', '.join(shipped)}."
        )
    raise ModelError(
        f"{unknown_name('study', str(name_or_path), shipped)} "
        "These are the shipped ones; or give the path of a study file."
    )


def load_study(name_or_path: str | Path, count: int | None = None) -> Study:
    """Read and check a study file.

    Parameters
    ----------
    name_or_path : str or path
    count : int, optional
        About how many points to take instead of what the file says; of Saltelli's points, how many base points.

    Raises
    ------
    ModelError
        For anything wrong: the message names the file, the line or the key, and what is allowed.
    """
    path = find_study(name_or_path)
    if count is not None and count < 1:
        raise ModelError(f"study: count = {count}; give at least one point.")
    if is_store(path):
        raise ModelError(f"{str(path)!r} is the store of a study; give the study file (.toml) here.")
    try:
        text = path.read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ModelError(f"study file {str(path)!r} cannot be read as text in UTF-8: {error}.") from error
    try:
        content = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ModelError(f"{path}: {error}.") from error
    return _Reader(path, text).study(content, count)


class _Reader:
    """Turns the content of a study file into a study, and whatever is wrong with it into a sentence."""

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
        for key in content:
            if key not in allowed:
                self.wrong(table, key, unknown_name("key", key, allowed))

    def study(self, content: Mapping[str, Any], count: int | None) -> Study:
        self.known(content, "", KEYS[""])
        problem = self.take(content, "", "problem", str, None)
        if problem not in shipped_problems():
            problem = str(self.beside(problem)) if problem.endswith(".py") else problem
        job = self.take(content, "", "job", str, None)
        if job not in JOBS and ":" in job:
            file, _, name = job.rpartition(":")
            job = f"{self.beside(file)}:{name}"
        values = self.take(content, "", "values", dict, {})
        options = self.take(content, "", "options", dict, {})
        try:
            wrong = wrong_option(job_function(job), options)
        except ModelError as error:
            self.wrong("", "job", str(error))
        if wrong:
            self.wrong("options", *wrong)
        try:
            system = task_of(job, problem, values, options).system()
        except ModelError as error:
            self.wrong("", "problem", str(error))
        points = self.points(self.take(content, "", "points", dict, None), system, count)
        figures = self.take(content, "", "figures", list, [])
        for figure in figures:
            self.figure(figure, points)
        title = self.take(content, "", "title", str, self.path.stem)
        outputs = tuple(self.take(content, "", "outputs", list, []))
        for name in outputs:
            if not isinstance(name, str):
                self.wrong("", "outputs", f"got {name!r}; give names of outputs.")
        return Study(self.path, title, problem, job, values, options, points, outputs, tuple(figures))

    def beside(self, file: str) -> Path:
        """Return a path, relative to the study file."""
        path = Path(file).expanduser()
        return path if path.is_absolute() else (self.path.parent / path).resolve()

    def figure(self, figure: Any, points: Points) -> None:
        if not isinstance(figure, dict):
            self.wrong("", "figures", "write each one as a table [[figures]].")
        kind = self.take(figure, "figures", "kind", str, None)
        if kind not in FIGURES:
            self.wrong("figures", "kind", unknown_name("kind of figure", kind, FIGURES))
        needed, may = FIGURES[kind]
        self.known(figure, "figures", ("kind", *needed, *may))
        for key in needed:
            self.take(figure, "figures", key, str, None)
        for key in set(may) & set(figure):
            if key == "inputs":
                self.inputs(figure[key], points)
            elif key == "colour":
                self.take(figure, "figures", key, str, None)
            else:
                self.numbers("figures", key, figure[key])
        if kind == "map":
            for key in ("x", "y"):
                if figure[key] not in points.names:
                    self.wrong("figures", key, unknown_name("input", figure[key], points.names))
        if kind == "sensitivity" and points.kind != "saltelli":
            self.wrong("figures", "kind", f"sensitivity needs points with sample = 'saltelli'; got {points.kind!r}.")

    def inputs(self, given: Any, points: Points) -> None:
        """Check the inputs that a figure names."""
        if not isinstance(given, list) or not given:
            self.wrong("figures", "inputs", f"got {given!r}; give a list of inputs.")
        for name in given:
            if name not in points.names:
                self.wrong("figures", "inputs", unknown_name("input", str(name), points.names))

    def numbers(self, table: str, key: str, given: Any) -> list[float]:
        """Return a number or a list of numbers as a list."""
        found = given if isinstance(given, list) else [given]
        if not all(isinstance(v, int | float) and not isinstance(v, bool) for v in found):
            self.wrong(table, key, f"got {given!r}; give a number or a list of numbers.")
        return [float(v) for v in found]

    # --- points -------------------------------------------------------------------------------

    def points(self, content: Mapping[str, Any], system: System, count: int | None) -> Points:
        self.known(content, "points", KEYS["points"])
        sample = self.take(content, "points", "sample", str, None)
        if sample not in SAMPLES:
            self.wrong("points", "sample", unknown_name("sample", sample, SAMPLES))
        given = self.take(content, "points", "parameters", dict, {})
        for name in given:
            if name not in system.parameter_names:
                self.wrong("points.parameters", name, unknown_name("parameter", name, system.parameter_names))
        try:
            found = self._made(sample, content, given, system, count)
            found.check(system)
        except ModelError as error:
            if str(self.path) in str(error):
                raise
            self.wrong("points", "sample", str(error))
        return found

    def _made(
        self, sample: str, content: Mapping[str, Any], given: Mapping[str, Any], system: System, count: int | None
    ) -> Points:
        if sample == "grid":
            return _thinned({n: self.axis(n, v, system) for n, v in given.items()}, count)
        if sample == "list":
            return sampling.listed(self.take(content, "points", "rows", list, None)[:count])
        if sample == "csv":
            points = sampling.from_csv(self.beside(self.take(content, "points", "file", str, None)))
            return Points(points.names, points.values[:count], points.kind)
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
        self.known(given, "points.parameters", ("low", "high", "count", "unit"))
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
        values = {k: v for k, v in given.items() if k not in ("distribution", "unit", "around")}
        for key, value in values.items():
            if not isinstance(value, int | float) or isinstance(value, bool):
                self.wrong("points.parameters", name, f"{key} = {value!r}; give a number.")
        if "around" in given:
            self.take(given, "points.parameters", "around", (int, float), None)
            return sampling.around(system, float(given["around"]), [name])[name]
        factor = self.factor(name, given, system)
        kind = given.get("distribution", "uniform")
        try:
            frozen = named_distribution(kind, values)
        except ModelError as error:
            self.wrong("points.parameters", name, str(error))
        return frozen if factor == 1.0 else Scaled(frozen, factor)

    def factor(self, name: str, given: Mapping[str, Any], system: System) -> float:
        own = system.parameter(name).unit
        try:
            return unit_factor(str(given.get("unit", own)), own, name)
        except ModelError as error:
            self.wrong("points.parameters", name, str(error))


def _thinned(axes: Mapping[str, list[float]], count: int | None) -> Points:
    """Return a grid, of about ``count`` points with the same ends where that is asked for."""
    if count is not None:
        total = float(np.prod([len(v) for v in axes.values()]))
        share = min(1.0, count / total) ** (1 / len(axes))
        kept = {n: max(min(2, len(v)), round(share * len(v))) for n, v in axes.items()}
        axes = {n: [v[i] for i in np.linspace(0, len(v) - 1, kept[n]).round().astype(int)] for n, v in axes.items()}
    return sampling.grid(axes)
