"""Figures of contact geometry and of equivalent conicity."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from hbbogie.errors import ModelError, unknown_name
from hbbogie.plot.appearance import Array, axes, legend, styled
from hbbogie.results import Conicity, ContactGeometry

QUANTITIES = ("radius difference", "contact angle", "contact point")


@styled
def contact(found: ContactGeometry, y: str = "radius difference", ax: Axes | None = None) -> Axes:
    """Draw contact geometry over the lateral shift of the wheelset.

    Parameters
    ----------
    found : ContactGeometry
    y : str
        "radius difference", "contact angle" (to the plane of the track), or "contact point" (on wheel and rail).
    ax : Axes

    Raises
    ------
    ModelError
        For another quantity.
    """
    if y not in QUANTITIES:
        raise ModelError(unknown_name("quantity", y, QUANTITIES))
    ax = axes(ax, (6.6, 4.2))
    ax.set_xlabel("lateral shift of the wheelset [mm]")
    if y == "radius difference":
        ax.plot(found.shift, found.radius_difference)
        ax.set_ylabel("rolling radius difference [mm]")
        return ax
    lines: dict[str, Array]
    if y == "contact angle":
        lines = {f"{side} wheel": np.degrees(getattr(found, f"angle_{side}")) for side in ("right", "left")}
        ax.set_ylabel("contact angle [deg]")
    else:
        pairs = [(on, side) for on in ("wheel", "rail") for side in ("right", "left")]
        lines = {f"on the {side} {on}": getattr(found, f"{on}_{side}") for on, side in pairs}
        ax.set_ylabel("contact point, positive outwards [mm]")
    for text, values in lines.items():
        ax.plot(found.shift, values, ".", ms=3.5, label=text)  # the contact jumps: no lines between its places
    return legend(ax)


@styled
def conicity(curve: Conicity, ax: Axes | None = None) -> Axes:
    """Draw the equivalent conicity over the amplitude, by EN 15302, least squares and describing function.

    Parameters
    ----------
    curve : Conicity
    ax : Axes
    """
    ax = axes(ax, (6.6, 4.2))
    for values, line, text in (
        (curve.equivalent, "-", "EN 15302"),
        (curve.least_squares, (0, (4, 1.8)), "least squares"),
        (curve.harmonic, (0, (1, 1.6)), "describing function"),
    ):
        ax.plot(curve.amplitude, values, ls=line, label=text)
    ax.set_xlabel("amplitude of the wheelset [mm]")
    ax.set_ylabel("equivalent conicity")
    ax.set_ylim(bottom=min(0.0, np.nanmin(curve.least_squares), np.nanmin(curve.harmonic)))
    return legend(ax)
