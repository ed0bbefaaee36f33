"""Problem files: find them, load them, build their systems.

A problem is a Python file with a docstring (source, assumptions, symbols with units) and

- ``SYSTEM``: a function that takes parameter values as keywords and returns a `System`;
- ``PARAMETER``, optional: name of the parameter that is varied by default;
- ``RANGE``, optional: smallest and largest value of that parameter, (lo, hi).

A problem that needs more than one file is a folder. Its ``__init__.py`` provides these names by importing them from the
modules beside it, as in ``from .bogie import SYSTEM``.

Worker processes. A problem is loaded as the module ``hbbogie_problem_<name>``. For a user's problem, the hash of its
path is appended to the name. The module is in ``sys.modules`` but not on the import path. Its functions and classes can
therefore be pickled, and a forked worker finds them. A newly started worker has to load the problem first. The name is
the same in every process, so this is enough::

    ProcessPoolExecutor(initializer=load_problem, initargs=(path,))

A `System` needs none of this, since it can be pickled on its own.
"""

from __future__ import annotations

import hashlib
import importlib.util
import inspect
import os
import sys
import traceback
from importlib.machinery import FileFinder, SourceFileLoader
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

from hbbogie.brief import lines
from hbbogie.errors import ModelError, told, unknown_name
from hbbogie.model.ranges import default_reach
from hbbogie.model.system import System


def shipped_folder() -> Path:
    """Return the folder of the shipped problems: inside an installed package, beside it in a checkout."""
    package = Path(__file__).resolve().parents[1]
    inside = package / "problems"
    return inside if inside.is_dir() else package.parent / "problems"


def shipped_problems() -> tuple[str, ...]:
    """Return the names of the problems that come with the package, in alphabetical order."""
    folder = shipped_folder()
    found = [f.stem for f in folder.glob("*.py")] + [f.parent.name for f in folder.glob("*/__init__.py")]
    return tuple(sorted(name for name in found if not name.startswith("_")))


def load_problem(name_or_path: str | os.PathLike[str]) -> ModuleType:
    """Return the module of a problem.

    Parameters
    ----------
    name_or_path : str or path
        Name of a shipped problem, or path of an existing file that ends in .py, or of a folder with an
        ``__init__.py``.

    Returns
    -------
    module
        Loaded once in a process as long as its files stay as they are, and afresh when one has changed. Its
        ``__source_hash__`` is the hash of what was loaded.

    Raises
    ------
    ModelError
        When there is no such file or problem, or when the file raises an error while it is executed.

    Examples
    --------
    >>> load_problem("van_der_pol").van_der_pol(mu=2.0).values["mu"]
    2.0
    """
    path = _locate(name_or_path)
    name = _module_name(path)
    try:
        source = b"\0".join(file.read_bytes() for file in _files(path))
    except OSError as error:
        raise ModelError(f"problem file {str(path)!r} cannot be read: {error.strerror}.") from error
    digest = hashlib.sha256(source).hexdigest()[:16]
    before = sys.modules.get(name)
    if before is not None and getattr(before, "__source_hash__", digest) == digest:
        return before
    _forget(name)
    loader = _Source(name, str(path))
    module = importlib.util.module_from_spec(importlib.util.spec_from_loader(name, loader))  # type: ignore[arg-type]
    module.__class__ = Problem
    module.__dict__["__source_hash__"] = digest
    for folder in getattr(module, "__path__", ()):
        sys.path_importer_cache[folder] = FileFinder(folder, (_Source, [".py"]))
    sys.modules[name] = module  # before execution: dataclasses look their module up
    try:
        loader.exec_module(module)
    except (Exception, SystemExit) as error:
        _forget(name)
        raise ModelError(_failure(error, path, "cannot be loaded")) from error
    except BaseException:
        _forget(name)
        raise
    return module


class Problem(ModuleType):
    """A problem's module, which says what it holds, and pickles by its file."""

    def __repr__(self) -> str:
        first = (self.__doc__ or "no description").strip().partition("\n")[0]
        builder, own, span = (getattr(self, name, None) for name in ("SYSTEM", "PARAMETER", "RANGE"))
        over = f"parameter {own}" + (f" from {span[0]:g} to {span[1]:g}" if own and span else "")
        path = Path(str(self.__file__))
        return lines(
            f"Problem {(path.parent if path.stem == '__init__' else path).stem!r}: {first}",
            f"system from .{getattr(builder, '__name__', 'SYSTEM')}(...)" if builder else "no SYSTEM",
            over if own else "",
        )

    def __reduce__(self) -> tuple[Any, ...]:
        return load_problem, (self.__file__,)


class _Source(SourceFileLoader):
    """Compiles what stands in the file: the bytecode cache takes a file for the same by time and size."""

    def get_code(self, fullname: str) -> CodeType:
        return self.source_to_code(self.get_data(self.path), self.path)


def problem_file(function: object) -> str | None:
    """Return the file of the problem that a function is part of, None of any other function."""
    module = sys.modules.get(getattr(function, "__module__", None) or "")
    package = sys.modules.get(module.__name__.partition(".")[0]) if module else None
    return str(package.__file__) if package and hasattr(package, "__source_hash__") else None


def system_of(module: ModuleType, /, **overrides: Any) -> System:
    """Return the system of a problem module.

    Parameters
    ----------
    module : module
        As returned by `load_problem`.
    **overrides
        Options of the module's builder, and parameter values that replace the defaults.

    Raises
    ------
    ModelError
        When the module has no builder ``SYSTEM``, the builder fails or does not take such a keyword, or
        what it returns is not a `System`.
    """
    where = f"problem {getattr(module, '__file__', None) or module.__name__!r}"
    builder = getattr(module, "SYSTEM", None)
    if builder is None:
        raise ModelError(f"{where} has no SYSTEM; write SYSTEM = f, with f a function that returns a System.")
    if not callable(builder):
        raise ModelError(
            f"{where}: SYSTEM is of type {type(builder).__name__}; it must be a function that takes "
            "parameter values as keywords and returns a System."
        )
    taken = _keywords_of(builder, overrides)
    try:
        system = builder(**taken)
    except ModelError:
        raise
    except Exception as error:
        path = Path(getattr(module, "__file__", None) or module.__name__)
        raise ModelError(_failure(error, path, "cannot build its system")) from error
    if not isinstance(system, System):
        raise ModelError(
            f"{where}: {getattr(builder, '__name__', 'SYSTEM')}() returned an object of type "
            f"{type(system).__name__}; it must return a System."
        )
    return system.with_parameters(**{name: value for name, value in overrides.items() if name not in taken})


def _locate(name_or_path: str | os.PathLike[str]) -> Path:
    """Return the resolved path of the file of a problem, which is the ``__init__.py`` of one that is a folder."""
    if not isinstance(name_or_path, str | os.PathLike):
        raise ModelError(
            f"load_problem: got {told(name_or_path)}; give the name of a shipped problem, such as 'yang1995', "
            "or the path of a .py file."
        )
    text = os.fspath(name_or_path)
    if text.endswith(".py"):
        path = Path(text).expanduser()
        if path.is_file():
            return path.resolve()
        if path.stem not in shipped_problems() or path.name != text:
            raise ModelError(
                f"no problem file {text!r} (looked for {str(path.absolute())!r}); give the path of an "
                f"existing .py file, or one of the shipped problems: {', '.join(shipped_problems())}."
            )
        text = path.stem  # the file name of a shipped problem, meant as its name
    if text in shipped_problems():
        folder = shipped_folder() / text
        return folder / "__init__.py" if folder.is_dir() else folder.with_suffix(".py")
    inside = Path(text).expanduser() / "__init__.py"
    if inside.is_file():
        return inside.resolve()
    raise ModelError(
        f"{unknown_name('problem', text, shipped_problems())} These are the shipped problems; "
        "or give the path of a .py file, or of a folder with an __init__.py."
    )


def _files(path: Path) -> list[Path]:
    """Return the files of a problem."""
    return sorted(path.parent.glob("*.py")) if path.name == "__init__.py" else [path]


def _forget(name: str) -> None:
    """Take a problem out of the loaded modules, with the modules of its folder."""
    for loaded in [m for m in sys.modules if m == name or m.startswith(f"{name}.")]:
        del sys.modules[loaded]


def _module_name(path: Path) -> str:
    """Return the name of a problem's module, the same in every process that sees the file at this path."""
    home = path.parent if path.name == "__init__.py" else path
    name = "hbbogie_problem_" + "".join(c if c.isalnum() else "_" for c in home.stem)
    if home.parent == shipped_folder():
        return name
    return f"{name}_{hashlib.sha256(str(home).encode()).hexdigest()[:12]}"


def _failure(error: BaseException, path: Path, what: str) -> str:
    """Return the sentence for an error raised in a problem file, with the file and the line in it."""
    own = {str(file) for file in _files(path)}
    if isinstance(error, SyntaxError) and error.filename in own:
        place = f"{error.filename}, line {error.lineno}"
    else:
        frames = reversed(traceback.extract_tb(error.__traceback__))
        place = next((f"{f.filename}, line {f.lineno}" for f in frames if f.filename in own), str(path))
    text = error.msg if isinstance(error, SyntaxError) else str(error)
    return f"problem file {place} {what}: {type(error).__name__}: {text}".rstrip(": ") + "."


def _keywords_of(builder: Any, overrides: dict[str, Any]) -> dict[str, Any]:
    """Return those of the overrides that the builder takes as keywords."""
    try:
        parameters = inspect.signature(builder).parameters
    except (TypeError, ValueError):
        return overrides  # a builder without a readable signature: let the call speak
    taken = [n for n, p in parameters.items() if p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY)]
    for name in set(taken) & set(overrides):
        if isinstance(parameters[name].default, bool) and overrides[name] not in (False, True):
            raise ModelError(f"{name!r} is a switch: got {told(overrides[name])}; give true or false.")
    if any(p.kind is p.VAR_KEYWORD for p in parameters.values()):
        return overrides
    return {name: value for name, value in overrides.items() if name in taken}


def default_interval(
    module: ModuleType, system: System, parameter: str | None = None
) -> tuple[str, tuple[float, float]]:
    """Return the parameter to follow and where: the module's PARAMETER and RANGE, where they apply.

    Otherwise the system's first parameter, and twice its value (at least 1) to either side, in its bounds.
    """
    own = getattr(module, "PARAMETER", None)
    name = own or next(iter(system.parameter_names), None) if parameter is None else parameter
    if name is None:
        raise ModelError(f"system {system.name!r} has no parameter to vary; give it one.")
    if name == own and hasattr(module, "RANGE"):
        return name, (float(module.RANGE[0]), float(module.RANGE[1]))
    return name, default_reach(system, name)
