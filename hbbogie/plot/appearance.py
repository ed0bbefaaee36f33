"""The house style, panels, scales of units, legends."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager
from functools import wraps
from pathlib import Path
from textwrap import wrap
from typing import Any, ParamSpec

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter
from numpy.typing import ArrayLike, NDArray

from hbbogie.errors import ModelError
from hbbogie.results import Orbit, Trajectory
from hbbogie.units import PREFIXES, readable

Array = NDArray[np.float64]
P = ParamSpec("P")
FEW = 4  # values that a title takes in
LETTER = 0.08  # width of a letter of a label [inch]
ZERO = 1e-15  # what a title takes for zero

# Okabe and Ito: told apart by the colour-blind, and in this order also when printed in grey
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#AA4499", "#E69F00", "#56B4E9", "#444444")
INK, PALE = "#333333", "#e4e4e4"
# one rule in every figure: what is stable is blue and solid, unstable orange and dashed, unknown grey and dotted
LINES: dict[str, Any] = {"stable": "-", "unstable": (0, (4, 1.8)), "unknown": (0, (1, 1.6))}
SHADES = {"stable": COLOURS[0], "unstable": COLOURS[1], "unknown": "#777777"}
NEUTRAL = ("#009E73", "#AA4499", "#444444", "#E69F00", "#56B4E9")  # colours that say nothing about stability
STYLE: dict[str, Any] = {
    "figure.figsize": (6.6, 4.2),
    "figure.constrained_layout.use": True,
    "font.size": 10.0,
    "pdf.fonttype": 42,  # TrueType, which can be searched and edited
    "ps.fonttype": 42,
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": "#777777",
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.prop_cycle": plt.cycler(color=NEUTRAL),
    "lines.linewidth": 1.8,
    "lines.solid_capstyle": "round",
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "legend.handlelength": 2.1,
    "legend.labelspacing": 0.25,
    "legend.handletextpad": 0.5,
}


def style() -> AbstractContextManager[None]:
    """Return a context in which matplotlib draws in the style of this module."""
    # a backend that is loaded inside the context is no longer interactive after it: notebooks would show one figure
    plt.draw_if_interactive()
    return plt.rc_context(STYLE)  # type: ignore[arg-type, unused-ignore]


def styled(draw: Callable[P, Axes]) -> Callable[P, Axes]:
    """Return the function so that it draws in the style of this module."""

    @wraps(draw)
    def styled(*args: P.args, **kwargs: P.kwargs) -> Axes:
        with style():
            return draw(*args, **kwargs)

    return styled


def save(figure: Figure | Axes, path: str | Path, close: bool = True) -> Path:
    """Write a figure, as PNG unless the path ends otherwise (.pdf, .svg), at 150 dots per inch.

    Parameters
    ----------
    figure : Figure or Axes
    path : str or path
    close : bool
        Whether the figure is closed afterwards and its memory freed.

    Raises
    ------
    ModelError
        When the directory does not exist.
    """
    drawn = figure if isinstance(figure, Figure) else figure_of(figure)
    target = Path(path)
    target = target if target.suffix else target.with_suffix(".png")
    if not target.parent.is_dir():
        folder = str(target.parent)
        raise ModelError(f"cannot write {str(target)!r}: the directory {folder!r} does not exist; make it.")
    with style():  # the kind of font in a PDF is decided here
        drawn.savefig(target, dpi=150, bbox_inches="tight", facecolor="white")
    if close:
        plt.close(drawn)
    return target


def panels(
    rows: int, columns: int, size: tuple[float, float] | None = None, title: str = ""
) -> tuple[Figure, NDArray[Any]]:
    """Return a figure with axes in rows and columns, shape (rows, columns), in the style of this module.

    Parameters
    ----------
    rows, columns : int
    size : (float, float), inch
        Width and height of the whole; in proportion to the number of panels where left out.
    title : str
    """
    with style():
        figure, grid = plt.subplots(
            rows, columns, figsize=size or (5.6 * columns, 3.8 * rows), layout="constrained", squeeze=False
        )
    if title:
        figure.suptitle(title, x=0.02, ha="left", fontsize=10.5)
    for ax in grid.flat:
        _dress(ax)
    return figure, grid


def one_legend(figure: Figure) -> Figure:
    """Replace the legends of all panels by one below them; what stands in several is named once."""
    entries: dict[str, Any] = {}
    for ax in figure.axes:
        for handle, text in zip(*ax.get_legend_handles_labels(), strict=True):
            entries.setdefault(text, handle)
        if (own := ax.get_legend()) is not None:
            own.remove()
    with style():
        if entries:
            figure.legend(entries.values(), entries.keys(), loc="outside lower center", ncols=min(4, len(entries)))
    return figure


def _dress(ax: Axes) -> None:
    """Give axes their grid and ticks, which are made late, outside the style."""
    ax.grid(True, color=PALE, linewidth=0.7)
    ax.tick_params(which="both", colors=INK, labelsize=9, length=3)
    ax.margins(0.04)


def axes(ax: Axes | None, size: tuple[float, float] | None = None) -> Axes:
    """Return the axes given, or new ones."""
    if ax is None:
        _, ax = plt.subplots(figsize=size, layout="constrained")
        _dress(ax)
    return ax


def figure_of(ax: Axes) -> Figure:
    """Return the figure that axes belong to."""
    return ax.figure.figure  # the whole figure, also from axes in a subfigure


def coordinate_of(o: Orbit | Trajectory, name: str | None) -> tuple[str, str]:
    """Return name and unit of a coordinate or output, of the first coordinate where none is named."""
    if o.naming.is_output(name):
        return str(name), o.naming.units.get(str(name), "1")
    i = 0 if name is None else o.index(name)
    return o.coordinates[i], o.units[i] or "1"


def scale(unit: str, data: Iterable[ArrayLike], label: str = "") -> tuple[float, str]:
    """Return factor and unit in which data of this size are read easily.

    A unit that stands already on the axis is kept, so that curves drawn later fit those drawn before.
    """
    for prefix, size in PREFIXES.items():
        if f"[{prefix}{unit}]" in " ".join(label.split()):
            return 1 / size, prefix + unit
    return readable(unit, max((float(np.abs(d).max(initial=0.0)) for d in map(np.asarray, data)), default=0.0))


def bracketed(text: str, unit: str) -> str:
    """Return the label of an axis; numbers without a unit have no bracket."""
    return f"{text} [{unit}]" if unit not in ("", "1") else text


def engineering(axis: Axis, label: str) -> None:
    """Label an axis in data units; its numbers are shown in the prefix in which they are read easily."""
    text, _, unit = label.removesuffix("]").rpartition(" [") if label.endswith("]") else (label, "", "")
    low, high = axis.get_view_interval()
    factor, shown = readable(unit, max(abs(low), abs(high)))
    if axis.get_scale() == "linear":
        axis.set_major_formatter(FuncFormatter(lambda v, _: f"{factor * v + 0.0:.10g}".replace("-", "\N{MINUS SIGN}")))
    axis.set_label_text(bracketed(text, shown))


def finish(ax: Axes, given: Axes | None, title: str = "") -> Axes:
    """Give axes their legend, and a figure of their own its title."""
    if given is None and title:
        figure_of(ax).suptitle(title, x=0.02, ha="left", fontsize=10.5)
    letters = int(figure_of(ax).get_size_inches()[1] * ax.get_position().height / LETTER)
    ax.set_ylabel("\n".join(wrap(" ".join(ax.get_ylabel().split()), letters)))
    return legend(ax, inside=given is not None)


def title_of(o: Orbit | Trajectory, without: str = "") -> str:
    """Return the title of a figure: the system, with its values where they are few, else with the first."""
    values = {n: v if abs(v) > ZERO else 0.0 for n, v in o.parameters.items() if n != without}
    few = values if len(values) <= FEW else {} if without else dict([*values.items()][:1])
    return f"{o.system}, {o.naming.values(few, FEW)}" if few else o.system


def legend(ax: Axes, inside: bool = False) -> Axes:
    """Put the legend above the axes in as many columns as fit, or inside where there is room; none without entries."""
    entries = [(h, text) for h, text in zip(*ax.get_legend_handles_labels(), strict=True) if _in_view(ax, h)]
    labels = [text for _, text in entries]
    shown: dict[str, Any] = {"handles": [handle for handle, _ in entries], "labels": labels}
    if inside and labels:
        ax.legend(loc="best", **shown)
        return ax
    # widths in inches: a letter at 8 points, a line sample with its gaps; new axes grow a little
    widths = np.array([0.45 + 0.06 * len(label.replace("$", "")) for label in labels])
    room = 1.1 * ax.get_position().width * figure_of(ax).get_size_inches()[0]
    for columns in range(len(labels), 0, -1):
        if columns == 1 or sum(part.max() for part in np.array_split(widths, columns)) <= room:
            place: dict[str, Any] = {"loc": "lower left", "bbox_to_anchor": (0.0, 1.0), "borderaxespad": 0.2}
            ax.legend(ncols=columns, columnspacing=1.2, **place, **shown)
            break
    return ax


def _in_view(ax: Axes, handle: Any) -> bool:
    """Tell whether what an entry of the legend stands for is within the axes; a line without data for all its like."""
    if not isinstance(handle, Line2D) or handle.get_transform() != ax.transData:
        return True

    def look(line: Line2D) -> tuple[str, Any]:
        return to_hex(line.get_color()), line.get_linestyle()

    like = [handle] if np.size(handle.get_xydata()) else [s for s in ax.lines if look(s) == look(handle)]
    drawn = [s.get_path().get_extents() for s in like if np.size(s.get_xydata())]
    return not drawn or any(box.overlaps(ax.viewLim) for box in drawn)
