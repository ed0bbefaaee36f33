"""The options of a job, checked against the names, types and conditions in its signature before anything runs."""

from __future__ import annotations

import inspect
import types
import typing
from collections.abc import Callable, Iterable, Mapping
from numbers import Integral, Real
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import numpy as np

from hbbogie.errors import ModelError, told, unknown_name

PLAIN: dict[Any, tuple[Any, str]] = {
    bool: (bool | np.bool_, "true or false"),
    int: (Integral, "a whole number"),
    float: (Real, "a number"),
    str: (str, "a text"),
    type(None): (type(None), "nothing"),
}


def wrong_option(function: Callable[..., Any], options: Mapping[str, Any]) -> tuple[str, str] | None:
    """Return an option that a job does not take or needs and does not get, and a sentence; None where all is well.

    Parameters
    ----------
    function : callable
        A job. Types in its signature are compared with the options, and conditions called, such as those of
        ``Annotated[int, whole]``. Annotations other than numbers, texts, and lists and mappings of them are not used.
    options : mapping
        Keywords for it.
    """
    try:
        parameters = list(inspect.signature(function).parameters.values())
    except (TypeError, ValueError):
        return None  # without a readable signature: let the call speak
    name = getattr(function, "__name__", "")
    first = next((p for p in parameters if p.kind not in (p.KEYWORD_ONLY, p.VAR_KEYWORD)), None)
    if first is None:
        return "", f"job {name} takes no system; its first argument is the system, the others are its options."
    others = [p for p in parameters if p is not first or p.kind is p.VAR_POSITIONAL]
    allowed = [p.name for p in others if p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY)]
    if not any(p.kind is p.VAR_KEYWORD for p in parameters):
        for key in options:
            if key not in allowed:
                return key, f"job {name}: {unknown_name('option', str(key), allowed)}"
    for p in others:
        if p.default is p.empty and p.kind not in (p.VAR_KEYWORD, p.VAR_POSITIONAL) and p.name not in options:
            return "", f"job {name} needs the option {p.name!r}; give it among the options of the job."
    return _wrong_value(function, name, {key: options[key] for key in allowed if key in options})


def _wrong_value(function: Callable[..., Any], name: str, options: Mapping[str, Any]) -> tuple[str, str] | None:
    try:
        kinds = typing.get_type_hints(function, include_extras=True)
    except Exception:  # whatever the annotations of a user's function lead to
        return None
    for key, value in options.items():
        try:
            if wanted := misfit(value, kinds.get(key, Any), key):
                return key, f"job {name}: got {_shown(value)}; give {wanted}."
        except ModelError as error:  # of a condition
            return key, f"job {name}: {error}"
    return None


def _shown(value: Any) -> str:
    return repr(value)[:80] if isinstance(value, list | tuple | dict) else told(value)


def misfit(value: Any, kind: Any, name: str = "") -> str:
    """Return what belongs in the place of a value that is not of a type; empty where it fits.

    Parameters
    ----------
    value : object
    kind : type, or what `typing` makes of types
    name : str
        Of the value, for the conditions.

    Raises
    ------
    ModelError
        When a condition is not met.
    """
    origin, inside = get_origin(kind), get_args(kind)
    if kind in PLAIN:
        fits = isinstance(value, PLAIN[kind][0]) and (kind is bool or not isinstance(value, bool | np.bool_))
        return "" if fits else PLAIN[kind][1]
    if origin is Annotated:
        wanted = misfit(value, inside[0], name)
        for condition in inside[1:] if not wanted else ():
            if callable(condition):
                condition(name, value)
        return wanted
    if origin in (Union, types.UnionType):
        others = [misfit(value, k, name) for k in inside if not (k is type(None) and value is not None)]
        return "" if "" in others else " or ".join(others)
    if origin is Literal:
        return "" if value in inside else f"one of {', '.join(map(repr, inside))}"
    if isinstance(origin, type) and issubclass(origin, Mapping) and inside:
        return _inside(value.values(), [inside[-1]] * len(value)) if isinstance(value, Mapping) else "a table"
    if isinstance(origin, type) and issubclass(origin, Iterable) and inside:
        return _listed(value, inside if origin is tuple and ... not in inside else None, inside[0])
    return ""


def _listed(value: Any, each: tuple[Any, ...] | None, every: Any) -> str:
    """Return what belongs in the place of a value that is no list of certain types, one for each entry or for all."""
    listed = value.tolist() if isinstance(value, np.ndarray) else value
    wanted = f"a list of {len(each)} values" if each else "a list"
    if not isinstance(listed, list | tuple) or (each and len(listed) != len(each)):
        return wanted
    return _inside(listed, each or [every] * len(listed))


def _inside(entries: Iterable[Any], kinds: Iterable[Any]) -> str:
    wanted = next((w for entry, kind in zip(entries, kinds, strict=True) if (w := misfit(entry, kind))), "")
    return f"{wanted} in each place" if wanted else ""
