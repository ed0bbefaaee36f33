"""Units: labels of quantities, and prefixes."""

from __future__ import annotations


def label(name: str, unit: str) -> str:
    """Return a header such as "V [m/s]"."""
    return f"{name} [{unit or '1'}]"
