"""Errors, and the wording of their messages: what is wrong, what was given, what is allowed and what to do."""

from __future__ import annotations

import inspect
import math
import os
from collections.abc import Callable, Iterable
from difflib import get_close_matches
from functools import wraps
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from hbbogie.threads import one_blas_thread

P = ParamSpec("P")
T = TypeVar("T")
BELONGS = {  # descriptions of expected arguments, by the name of the type
    "System": "a System, such as load_problem('yang1995').bogie()",
    "Equations": "equations, such as HarmonicBalance(15).equations(system)",
    "ExactEquations": "Exact().equations(system)",
    "CollocationEquations": "Collocation().equations(system)",
    "SolvesItself": "Exact().equations(system)",
    "Sampled": "a guess, as from_motion and from_orbit return",
    "CollocatedCycle": "a cycle, as collocated returns",
    "Rates": "Rates(system, parameter)",
    "Orbit": "an Orbit, as find_cycles and solve return",
    "Point": "a point of a branch, as at_grazing and exact_cycle return",
    "SpecialPoint": "a special point, as hopf_points and trace return",
    "Branch": "a Branch, as trace returns",
    "Trajectory": "a motion, as simulate returns",
    "str": "a name as text, such as 'V'",
    "PathLike": "a path",
    "Sequence": "a list",
    "list": "a list",
    "tuple": "a tuple",
    "ndarray": "an array",
    "Dataset": "the dataset that sweep returns",
    "Mapping": "values by name, such as {'q1': 0.01}",
}


class ModelError(ValueError):
    """The model, a parameter or an argument is not acceptable."""


# --- kinds of arguments -----------------------------------------------------------------------


def door(**kinds: type | tuple[type, ...]) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """Make a public function refuse arguments of the wrong kind before it begins; its defaults are always accepted.

    Inside, linear algebra uses one thread.

    Parameters
    ----------
    **kinds
        Type, or types, of each argument.
    """

    def dress(function: Callable[P, T]) -> Callable[P, T]:
        parameters = inspect.signature(function).parameters
        positional = [n for n, p in parameters.items() if p.kind is p.POSITIONAL_OR_KEYWORD]
        order = ", ".join(n for n in positional if parameters[n].default is inspect.Parameter.empty)

        @wraps(function)
        def checked(*args: P.args, **kwargs: P.kwargs) -> T:
            given = dict(zip(positional, args, strict=False)) | kwargs
            for name, kind in kinds.items():
                if name in given and given[name] is not parameters[name].default:
                    of_kind(f"{function.__name__}({order}): argument {name!r}", given[name], kind)
            with one_blas_thread():
                return function(*args, **kwargs)

        return checked

    return dress


def of_kind(what: str, given: Any, kind: type | tuple[type, ...]) -> None:
    """Raise `ModelError`, which says what is expected, unless a value has the type or one of the types."""
    if isinstance(given, kind):
        return
    names = [k.__name__ for k in (kind if isinstance(kind, tuple) else (kind,))]
    wanted = " or ".join(BELONGS.get(n, f"an object of type {n}") for n in names)
    raise ModelError(f"{what}: got {told(given)}; give {wanted}.{_hint(given, names)}")


def several(what: str, given: Any, kind: type[T]) -> list[T]:
    """Return one value, or a list of them, as a list; raise `ModelError` for an empty list and for other kinds."""
    many = [given] if isinstance(given, kind) else given
    if not isinstance(many, list | tuple):
        of_kind(what, given, kind)
    if not len(many):
        raise ModelError(f"{what}: got an empty list; give at least one.")
    for thing in many:
        of_kind(f"{what}, in the list", thing, kind)
    return list(many)


def _hint(given: Any, wanted: list[str]) -> str:
    """Return advice about a value that is nearly right."""
    name = getattr(given, "name", None)
    if "str" in wanted and isinstance(name, str):
        return f" Give its name, {name!r}."
    if isinstance(given, list | tuple) and len(given) and type(given[0]).__name__ in wanted:
        return " Give one of the list, such as its first."
    if callable(given) and not isinstance(given, type):
        return " Call the function, and give what it returns."
    return ""


def told(thing: Any) -> str:
    """Return a short description of a given value: plain values as they are written, and the type of others."""
    plain = isinstance(thing, str | int | float | bool | None) or getattr(thing, "shape", None) == ()
    text = repr(thing)[:80] if plain else ""
    return text or f"an object of type {type(thing).__name__}"


def named(where: str, kind: str, got: Any, allowed: Iterable[str]) -> str:
    """Return a name of a coordinate, a parameter or the like; raise `ModelError` unless it is one of those allowed."""
    names = list(allowed)
    if not isinstance(got, str):
        listed = ", ".join(names[:12]) + (" ..." if len(names) > 12 else "")
        raise ModelError(f"{where}: got {told(got)} as {kind}; give a name: {listed or '(none)'}.{_hint(got, ['str'])}")
    if got not in names:
        raise ModelError(f"{where}: {unknown_name(kind, got, names)}")
    return got


def unknown_name(kind: str, got: Any, allowed: Iterable[str]) -> str:
    """Return the sentence for an unknown name, with "did you mean" and the allowed names."""
    names = list(allowed)
    if not isinstance(got, str):
        return f"{kind}: got {told(got)}; give a name as text. Allowed: {', '.join(names) or '(none)'}."
    folded = {name.casefold(): name for name in names}
    close = get_close_matches(got, names, n=1, cutoff=0.5) or get_close_matches(got.casefold(), folded, n=1, cutoff=0.5)
    hint = f" Did you mean {folded.get(close[0].casefold(), close[0])!r}?" if close else ""
    return f"unknown {kind} {got!r}.{hint} Allowed: {', '.join(names) or '(none)'}."


def as_path(what: str, given: Any) -> Path:
    """Return a path with the home folder expanded; raise `ModelError` unless it is a text or a path."""
    if not isinstance(given, str | os.PathLike) or not os.fspath(given):
        raise ModelError(f"{what}: got {told(given)}; give a path as text, such as 'out/branch.nc'.")
    return Path(given).expanduser()


# --- numbers ----------------------------------------------------------------------------------


def as_number(value: Any) -> float:
    """Return a number as a float, and NaN for anything else (a text, a truth value, an expression, an array)."""
    kind = getattr(getattr(value, "dtype", None), "kind", "")  # NumPy values have one
    if isinstance(value, str | bytes | bool) or kind in ("b", "S", "U") or getattr(value, "ndim", 0) != 0:
        return float("nan")
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError, RuntimeError):  # CasADi raises RuntimeErrors
        return float("nan")


def positive(name: str, value: float, unit: str) -> float:
    """Return the value as a number; raise `ModelError` unless it is finite and above 0."""
    number = as_number(value)
    if not (math.isfinite(number) and number > 0):
        raise ModelError(
            f"{name}: got {told(value)}; give a finite number above 0"
            + (f" in {unit}." if unit not in ("", "1") else ".")
        )
    return number


def whole(name: str, value: Any, least: int = 1) -> int:
    """Return the value as a whole number; raise `ModelError` unless it is one, and not below the least."""
    number = as_number(value)
    if not (math.isfinite(number) and number == int(number) and number >= least):
        raise ModelError(f"{name}: got {told(value)}; give a whole number, {least} or more.")
    return int(number)


def pair(name: str, value: Any) -> tuple[float, float]:
    """Return two finite numbers (low, high) with low < high; raise `ModelError` for anything else."""
    try:
        low, high = map(as_number, value)
    except (TypeError, ValueError, RuntimeError):  # CasADi expressions are not iterable
        low = high = float("nan")
    if isinstance(value, str | dict) or not (math.isfinite(low) and math.isfinite(high) and low < high):
        got = f"({low:g}, {high:g})" if low == low and high == high else told(value)
        raise ModelError(f"{name}: got {got}; give two finite numbers (low, high) with low < high.")
    return low, high
