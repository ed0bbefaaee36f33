"""Units: labels and prefixes of physical quantities."""

from __future__ import annotations

import math
import re

from hbbogie.errors import ModelError

PREFIXES = {"": 1.0, "µ": 1e-6, "u": 1e-6, "m": 1e-3, "c": 1e-2, "k": 1e3, "M": 1e6, "G": 1e9}
# prefixes that make a quantity easy to read, each with the smallest size, in the bare unit, for which it is used
READABLE = {
    "m": (("", 1.0), ("m", 1e-3), ("µ", 0.0)),
    "rad": (("", 0.1), ("m", 1e-4), ("µ", 0.0)),
    "N": (("M", 1e6), ("k", 1e4), ("", 0.0)),
    "W": (("M", 1e6), ("k", 1e4), ("", 0.0)),
}


OTHERS = {  # further units, with what they are in the unit of a parameter
    ("km/h", "m/s"): 1 / 3.6,
    ("deg", "rad"): math.pi / 180,
    ("rpm", "rad/s"): math.pi / 30,
    ("Hz", "rad/s"): 2 * math.pi,
    ("N/mm", "N/m"): 1e3,
    ("kN/mm", "N/m"): 1e6,
    ("%", "1"): 0.01,
    ("%", ""): 0.01,
    ("t", "kg"): 1e3,
    ("min", "s"): 60.0,
}


def label(name: str, unit: str) -> str:
    """Return a header such as "V [m/s]"."""
    return f"{name} [{unit or '1'}]"


def behind(unit: str) -> str:
    """Return a unit as it stands behind a number, such as " m/s"; nothing where there is none."""
    return "" if unit in ("", "1") else f" {unit}"


def per_second(unit: str) -> str:
    """Return the unit of a rate of change, such as "m/s²" of "m/s"."""
    return f"{unit}²" if unit.endswith("/s") else "1/s" if unit in ("", "1") else f"{unit}/s"


def readable(unit: str, largest: float) -> tuple[float, str]:
    """Return the factor and the unit that make lengths, angles and forces of this size easy to read."""
    base = re.split("[/ ]", unit)[0]  # not "m2", where the prefix would be squared
    for prefix, least in READABLE.get(base, ()):
        if 0 < largest >= least:
            return 1 / PREFIXES[prefix], prefix + unit
    return 1.0, unit


def unit_factor(given: str, own: str, name: str) -> float:
    """Return the factor that converts a value in a given unit, such as "kN/m", to the parameter's own unit, "N/m".

    Raises
    ------
    ModelError
        When the given unit is neither the parameter's own unit with a prefix nor a common one beside it, such as km/h.
    """
    if (given, own) in OTHERS:
        return OTHERS[given, own]
    own_factor, bare = (PREFIXES["k"], own[1:]) if own.startswith("kg") else (1.0, own)
    for prefix, factor in PREFIXES.items():
        if given == prefix + bare:
            return factor / own_factor
    beside = "".join(f", or {unit}" for unit, of in OTHERS if of == own)
    raise ModelError(
        f"parameter {name!r}: got the unit {given!r}; allowed is its own, {own or '1'!r}, with or without "
        f"a prefix{beside}."
    )
