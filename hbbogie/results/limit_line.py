"""Limits that figures draw beside what is measured."""

from __future__ import annotations

from dataclasses import dataclass

from hbbogie.errors import ModelError, as_number, told


@dataclass(frozen=True)
class LimitLine:
    """A value that a quantity should not exceed.

    Attributes
    ----------
    value : float
    label : str
        Of the line in a figure.
    unit : str
        That of the quantity.
    source : str
        Where the limit comes from, and how far it was checked, in a sentence.

    Raises
    ------
    ModelError
        When the value is no finite number, or one of the others no text.
    """

    value: float
    label: str
    unit: str = ""
    source: str = ""

    def __post_init__(self) -> None:
        if not abs(as_number(self.value)) < float("inf"):
            raise ModelError(f"LimitLine: got {told(self.value)} as value; give a finite number.")
        for what, text in (("label", self.label), ("unit", self.unit), ("source", self.source)):
            if not isinstance(text, str) or (what == "label" and not text):
                raise ModelError(f"LimitLine: got {told(text)} as {what}; give a text, such as 'limit of comfort'.")
