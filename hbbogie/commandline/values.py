"""Values with units, from options and from files."""

from __future__ import annotations

import csv
import json
import re
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from hbbogie.errors import ModelError, told, unknown_name

NUMBER = re.compile(r"([+-]?(?:(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?|inf|nan))\s*([^\d\s.].*)?", re.IGNORECASE)
SWITCHES = {"true": True, "false": False}
EXAMPLE = 'such as V = "324 km/h" or K2 = 10e6'


def quantity(where: str, text: str) -> tuple[float, str]:
    """Return number and unit of a text such as "324 km/h", "324km/h" or "2.5e6"; the unit may be empty.

    Raises
    ------
    ModelError
        When the text does not begin with a number, and is neither true nor false.
    """
    if text.strip().lower() in SWITCHES:
        return SWITCHES[text.strip().lower()], ""
    found = NUMBER.fullmatch(text.strip())
    if found is None:
        raise ModelError(
            f"{where}: {text!r} is not a number; write it like 2.5e6, with a unit as in 324km/h if you like (true or "
            "false for a switch)."
        )
    return float(found[1]), (found[2] or "").strip()


def values_in(path: Path, option: str = "--values") -> dict[str, tuple[float, str]]:
    """Return the values of parameters in a file, each with its unit, which is empty where none is given.

    Parameters
    ----------
    path : Path
        A .toml or .json file of names and values, numbers or texts with a unit; or a .csv file with a line for each
        parameter: its name, its value and, if given, its unit. A first line "name, value, unit" is passed over.
    option : str
        That names it, for messages.

    Raises
    ------
    ModelError
        When the file cannot be read, is of another kind, or holds something else.
    """
    readers = {".toml": _toml, ".json": _json, ".csv": _csv}
    if path.suffix.lower() not in readers:
        raise ModelError(f"{option} {str(path)!r}: give a file that ends in {', '.join(readers)}.")
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise ModelError(f"{option} {str(path)!r}: {(error.strerror or str(error)).lower()}.") from error
    except UnicodeDecodeError:
        raise ModelError(f"{option} {str(path)!r}: the file is not text in UTF-8.") from None
    try:
        pairs = readers[path.suffix.lower()](text)
    except ValueError as error:  # of any of the parsers
        raise ModelError(
            f"{option} {str(path)!r} cannot be read: {error}; give names and values, {EXAMPLE}."
        ) from error
    found: dict[str, tuple[float, str]] = {}
    for name, value in pairs:
        if name in found:
            raise ModelError(f"{option} {str(path)!r}: {name!r} is given twice; leave one out.")
        found[name] = _value(f"{option} {str(path)!r}: {name}", value)
    return found


def numbers_in(path: Path, option: str) -> dict[str, float]:
    """Return the values of parameters in a file, all in their own units; raise `ModelError` for others."""
    given = values_in(path, option)
    for name, (value, unit) in given.items():
        if unit:
            raise ModelError(
                f"{option} {str(path)!r}: {name} = {value:g} {unit}; give a number in the parameter's own unit."
            )
    return {name: value for name, (value, _) in given.items()}


def _value(where: str, value: Any) -> tuple[float, str]:
    if isinstance(value, str):
        return quantity(where, value)
    if isinstance(value, int | float):
        return value, ""
    raise ModelError(f"{where}: got {told(value)}; give a number, or a text with a unit, {EXAMPLE}.")


def _toml(text: str) -> Iterable[tuple[str, Any]]:
    return tomllib.loads(text).items()


def _json(text: str) -> Iterable[tuple[str, Any]]:
    pairs = json.loads(text, object_pairs_hook=list)  # a dict would drop names given twice
    if not isinstance(pairs, list) or not all(isinstance(pair, tuple) for pair in pairs):
        raise ValueError("it holds no object of names and values")
    return pairs


def _csv(text: str) -> Iterable[tuple[str, Any]]:
    rows = [[cell.strip() for cell in row] for row in csv.reader(text.splitlines()) if any(map(str.strip, row))]
    if rows and rows[0][:2] == ["name", "value"]:
        rows = rows[1:]
    for row in rows:
        if len(row) not in (2, 3) or not row[0]:
            raise ValueError(f"the line {', '.join(row)!r} is not name, value or name, value, unit")
    return [(row[0], " ".join(row[1:]).strip()) for row in rows]


def in_own_units(given: Mapping[str, tuple[float, str]], units: Mapping[str, str]) -> dict[str, float]:
    """Return values in the units of the parameters.

    Parameters
    ----------
    given : mapping
        Values with units by name.
    units : mapping
        The unit of each parameter by name.

    Raises
    ------
    ModelError
        For a unit that does not fit, or a unit with a name that is no parameter's.
    """
    from hbbogie.units import unit_factor

    values = {}
    for name, (value, unit) in given.items():
        if unit and name not in units:
            raise ModelError(unknown_name("parameter", name, units))
        values[name] = value * unit_factor(unit, units[name], name) if unit else value
    return values
