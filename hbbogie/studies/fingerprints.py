"""Fingerprints of everything that determines the results of a study: problem, job, options, versions."""

from __future__ import annotations

import functools
import hashlib
import importlib
import inspect
import json
import platform
import re
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from types import CellType
from typing import Any

import numpy as np

from hbbogie.model.system import System


def problem_hash(system: System) -> str:
    """Return a hash of the equations and of the values and bounds of the parameters."""
    parts = [system.residual.serialize()]  # of the whole, with the forces of the elements
    parts += [f"{p.name} {system.values[p.name]!r} {p.unit} {p.bounds!r}" for p in system.parameters]
    return digest("\n".join(parts))


def options_text(options: Mapping[str, Any]) -> str:
    """Return the options of a job as JSON; of what JSON cannot hold, such as arrays, text and a hash of the content."""

    def shown(value: Any) -> Any:
        if isinstance(value, np.generic):
            return value.item()
        return f"{' '.join(str(value).split())} (hash {digest(repr(code_of(value)))})"

    return json.dumps(dict(sorted(options.items())), default=shown)


def digest(text: str) -> str:
    """Return a short hash of a text."""
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def source_of(function: Callable[..., Any]) -> str:
    """Return the source of the file a function stands in, nothing where there is no such file."""
    try:
        file = inspect.getsourcefile(function)
        return Path(file).read_text("utf-8") if file and Path(file).is_file() else ""
    except (OSError, TypeError, UnicodeDecodeError):
        return ""


def code_of(value: Any, above: tuple[Any, ...] = ()) -> Any:
    """Return what a function does, in a form whose text is the same in every process: also what it closes over."""
    if any(value is v for v in above):  # functions that close over each other
        return "itself"
    inside = functools.partial(code_of, above=(*above, value))
    if inspect.ismethod(value):
        return inside(value.__func__), inside(value.__self__)
    if inspect.isfunction(value):
        cells = [inside(c.cell_contents) for c in value.__closure__ or () if c != CellType()]
        return inside(value.__code__), inside(value.__defaults__), inside(value.__kwdefaults__), cells
    if inspect.iscode(value):
        return value.co_code.hex(), value.co_names, [inside(c) for c in value.co_consts]
    if isinstance(value, frozenset | set):
        return sorted(repr(inside(v)) for v in value)
    if isinstance(value, tuple | list):
        return [inside(v) for v in value]
    if isinstance(value, dict):
        return [(inside(k), inside(v)) for k, v in value.items()]
    array = _array(value)
    if array is not None:
        content = repr(inside(array.tolist())).encode() if array.dtype.hasobject else array.tobytes()
        return array.dtype.str, array.shape, hashlib.sha256(content).hexdigest()
    if is_dataclass(value) and not isinstance(value, type | System):
        return type(value).__qualname__, [(f.name, inside(getattr(value, f.name))) for f in fields(value)]
    if isinstance(value, System):
        return problem_hash(value)
    # neither addresses nor the name that the running script has in worker processes
    return re.sub(r" at 0x[0-9a-fA-F]+", "", repr(value)).replace("__mp_main__", "__main__")


def _array(value: Any) -> np.ndarray[Any, Any] | None:
    """Return what is like an array, such as a data frame or a matrix of CasADi, as one, and None for anything else."""
    if not hasattr(value, "__array__") or isinstance(value, np.generic | type):
        return None
    try:
        return np.asarray(value)
    except Exception:  # symbols
        return None


def versions() -> dict[str, str]:
    """Return the versions of everything that has a share in the numbers."""
    found = {"python": platform.python_version(), "platform": platform.platform(terse=True)}
    for name in ("hbbogie", "casadi", "numpy", "scipy"):
        found[name] = str(getattr(importlib.import_module(name), "__version__", ""))
    return found
