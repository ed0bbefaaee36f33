"""Study files (TOML): problem, job, points, outputs and figures of a study, checked before anything runs."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hbbogie.brief import brief
from hbbogie.errors import ModelError, unknown_name
from hbbogie.model.problem import load_problem, shipped_folder, shipped_problems, system_of
from hbbogie.model.system import System
from hbbogie.studies.jobs import JOBS, job_function
from hbbogie.studies.options import wrong_option
from hbbogie.studies.sampling import Points
from hbbogie.studies.store_file import is_store
from hbbogie.studies.study_points import PointsReader
from hbbogie.studies.sweeps import task_of

KEYS = ("title", "problem", "job", "outputs", "values", "options", "points", "figures")
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
class Look:
    """How the results of a study are shown.

    Attributes
    ----------
    path : Path
        Of the study file.
    title : str
    outputs : tuple of str
        Shown in the report; all of them where empty.
    figures : tuple of dict
        Of each figure its ``kind`` and the names it draws.
    """

    path: Path
    title: str
    outputs: tuple[str, ...]
    figures: tuple[dict[str, Any], ...]

    __repr__ = brief


@dataclass(frozen=True, eq=False)
class Study(Look):
    """What a study file asks for, besides how the results are shown.

    Attributes
    ----------
    problem : str
        Name of a shipped problem, or path.
    job : str
        Name of a job, or "path:function".
    values, options : dict
        Parameter values common to all points; keywords of the job.
    points : Points
    """

    problem: str
    job: str
    values: dict[str, Any]
    options: dict[str, Any]
    points: Points

    __repr__ = brief


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
    if count is not None and count < 1:
        raise ModelError(f"study: count = {count}; give at least one point.")
    reader, content = _read(name_or_path)
    return reader.study(content, count)


def read_look(name_or_path: str | Path, inputs: Sequence[str], sampling: str) -> Look:
    """Read what a study file says about the report on its results, without running anything of its problem or job.

    Parameters
    ----------
    name_or_path : str or path
    inputs : sequence of str
        Names of the parameters that the finished study varies.
    sampling : str
        How its points were chosen.

    Raises
    ------
    ModelError
        For anything wrong in these parts of the file.
    """
    reader, content = _read(name_or_path)
    reader.known(content, "", KEYS)
    return reader.look(content, inputs, sampling)


def points_file(name_or_path: str | Path) -> Path | None:
    """Return the file that a study reads its points from; None where the study file says them itself."""
    reader, content = _read(name_or_path)
    file = reader.take(reader.take(content, "", "points", dict, {}), "points", "file", str, "")
    return reader.beside(file) if file else None


def _read(name_or_path: str | Path) -> tuple[_Reader, dict[str, Any]]:
    """Return the reader of a study file, and its content."""
    path = find_study(name_or_path)
    if is_store(path):
        raise ModelError(f"{str(path)!r} is the store of a study; give the study file (.toml) here.")
    try:
        text = path.read_text("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise ModelError(f"study file {str(path)!r} cannot be read as text in UTF-8: {error}.") from error
    try:
        content = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ModelError(f"{path}: {error}.") from error
    return _Reader(path, text), content


class _Reader(PointsReader):
    """Turns the content of a study file into a study, and whatever is wrong with it into a sentence."""

    def study(self, content: Mapping[str, Any], count: int | None) -> Study:
        self.known(content, "", KEYS)
        problem = self.take(content, "", "problem", str, None)
        if problem not in shipped_problems():
            beside = self.beside(problem)
            problem = str(beside) if problem.endswith(".py") or beside.is_dir() else problem
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
        system = self.system(problem, job, values, options)
        points = self.points(self.take(content, "", "points", dict, None), system, count)
        for name in set(points.names) & set(values):
            self.wrong("values", name, f"the points give values of {name!r}, too; leave it out of one of both.")
        shown = self.look(content, points.names, points.kind)
        return Study(self.path, shown.title, shown.outputs, shown.figures, problem, job, values, options, points)

    def look(self, content: Mapping[str, Any], inputs: Sequence[str], sampling: str) -> Look:
        """Return how the results are to be shown."""
        figures = self.take(content, "", "figures", list, [])
        for figure in figures:
            self.figure(figure, inputs, sampling)
        title = self.take(content, "", "title", str, self.path.stem)
        outputs = tuple(self.take(content, "", "outputs", list, []))
        for name in outputs:
            if not isinstance(name, str):
                self.wrong("", "outputs", f"got {name!r}; give names of outputs.")
        return Look(self.path, title, outputs, tuple(figures))

    def system(self, problem: str, job: str, values: Mapping[str, Any], options: Mapping[str, Any]) -> System:
        """Return the system at the values common to all points."""
        try:
            return task_of(job, problem, values, options).system()
        except ModelError as error:
            self.wrong(*_culprit(problem, values), str(error))

    def figure(self, figure: Any, inputs: Sequence[str], sampling: str) -> None:
        """Check what a figure asks for."""
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
                self.inputs(figure[key], inputs)
            elif key == "colour":
                self.take(figure, "figures", key, str, None)
            else:
                self.numbers("figures", key, figure[key])
        if kind == "map":
            for key in ("x", "y"):
                if figure[key] not in inputs:
                    self.wrong("figures", key, unknown_name("input", figure[key], inputs))
        if kind == "sensitivity" and sampling != "saltelli":
            self.wrong("figures", "kind", f"sensitivity needs points with sample = 'saltelli'; got {sampling!r}.")

    def inputs(self, given: Any, names: Sequence[str]) -> None:
        """Check the inputs that a figure names."""
        if not isinstance(given, list) or not given:
            self.wrong("figures", "inputs", f"got {given!r}; give a list of inputs.")
        for name in given:
            if name not in names:
                self.wrong("figures", "inputs", unknown_name("input", str(name), names))


def _culprit(problem: str, values: Mapping[str, Any]) -> tuple[str, str]:
    """Return table and key of what makes the system impossible."""
    try:
        system_of(load_problem(problem))
    except ModelError:
        return "", "problem"
    for name, value in values.items():
        try:
            system_of(load_problem(problem), **{name: value})
        except ModelError:
            return "values", name
    try:
        system_of(load_problem(problem), **values)
    except ModelError:
        return "values", ""
    return "options", "parameter"
