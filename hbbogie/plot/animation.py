"""Motions that move: the system itself, phase portrait and time history beside it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib import animation
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from hbbogie.errors import ModelError, as_path, of_kind, whole
from hbbogie.plot.appearance import COLOURS, INK, PALE, SHADES, bracketed, coordinate_of, panels, scale, style, title_of
from hbbogie.plot.orbits import on_cylinder, turns_at
from hbbogie.results import Orbit, Trajectory
from hbbogie.results.sketch import Sketch
from hbbogie.units import per_second

Array = NDArray[np.float64]
Redraw = Callable[[int], list[Any]]  # frame -> what has moved
FRAMES = 50  # of one period, or of a whole motion
PERIODS = 2.0  # shown in the time history of a cycle
PACE = 20  # frames a second
MARGIN = 0.1  # around a sketch, in its unit
LOOKS: dict[str, dict[str, Any]] = {
    "ground": {"color": "#999999", "lw": 3.0},
    "body": {"color": INK, "lw": 2.0},
    "part": {"color": COLOURS[0], "lw": 4.0},
    "contact": {"color": "#999999", "lw": 3.0},
}
LIT = {"color": COLOURS[1], "lw": 8.0}  # a contact that is closed
FORMS = (".gif", ".mp4")
DOTS, COLOURS_OF_GIF = 80, 32  # an inch; and in the palette


def animate(
    motion: Orbit | Trajectory,
    path: str | Path,
    sketch: Sketch | None = None,
    coordinate: str | None = None,
    *,
    frames: int = FRAMES,
) -> Path:
    """Write a moving picture of a motion: a cycle over one period, so that it goes on for ever, or a whole trajectory.

    Parameters
    ----------
    motion : Orbit or Trajectory
    path : str or path
        Ends in .gif, or in .mp4 where the program ffmpeg is installed.
    sketch : callable, optional
        (coordinates by name, parameters by name) -> shapes; see `hbbogie.results.Shape`. The first line of its
        docstring is printed above them.
    coordinate : str, optional
        Of the phase portrait and the time history; the first one where left out.
    frames : int
        Number of pictures.

    Returns
    -------
    Path

    Raises
    ------
    ModelError
        For an equilibrium, another ending of the path, a folder that is not there, or where ffmpeg is missing.
    """
    of_kind("animate: motion", motion, (Orbit, Trajectory))
    if isinstance(motion, Orbit) and not motion.H:
        raise ModelError("animate: the orbit is an equilibrium, which does not move; give a cycle or a trajectory.")
    frames, target = whole("animate: frames", frames, 2), check_target(path)
    cycle = isinstance(motion, Orbit)
    if isinstance(motion, Orbit):
        length = PERIODS * motion.period
        t = (motion.period * np.arange(PERIODS)[:, None] + motion.times()).ravel()
    else:
        t = np.linspace(0.0, length := float(motion.t[-1]), 2000)
    stops = np.linspace(0.0, motion.period if isinstance(motion, Orbit) else length, frames, endpoint=not cycle)
    name, unit = coordinate_of(motion, coordinate)
    i, q = motion.index(name), _sampled(motion, stops, 0)
    x = _sampled(motion, t, 0)[:, i]
    factor, shown = scale(unit, [x])
    x, v = factor * x, factor * _sampled(motion, t, 1)[:, i]
    x_at, v_at = factor * q[:, i], factor * _sampled(motion, stops, 1)[:, i]
    figure, grid = panels(1, 2, (8.4, 3.2), title_of(motion)) if sketch is None else _with_sketch(motion)
    phase, history = grid[0]
    phase.set_xlabel(bracketed(motion.naming.plain(name), shown), fontsize=9)
    phase.set_ylabel(bracketed("velocity", shown.removesuffix(unit) + per_second(unit)), fontsize=9)
    history.set_xlabel("time [s]", fontsize=9)
    history.set_ylabel(bracketed(name, shown), fontsize=9)
    colour = _colour(motion)
    curve, dots = (x, v), (x_at, v_at)
    if isinstance(motion, Orbit) and motion.advance:
        bare, there = on_cylinder([motion], name, x / factor, v)
        curve, dots = (factor * bare, there), (x_at - factor * turns_at([motion], name, x_at / factor), v_at)
    redraw = [
        _moving_dot(phase, curve, dots, colour),
        _moving_dot(history, (t, x), (stops, x_at), colour),
    ]
    if sketch is not None:
        redraw.append(_drawing(figure.axes[-1], motion, sketch, q))

    def show(frame: int) -> list[Any]:
        return [artist for part in redraw for artist in part(frame)]

    show(0)
    figure.canvas.draw()
    figure.set_layout_engine("none")  # the panels stay where they are
    with style():
        if target.suffix == ".gif":
            _write_gif(figure, show, frames, target)
        else:
            film = animation.FuncAnimation(figure, show, frames=frames, blit=False)
            film.save(target, writer="ffmpeg", fps=PACE, dpi=DOTS)
    plt.close(figure)
    return target


def _write_gif(figure: Figure, show: Callable[[int], object], frames: int, target: Path) -> None:
    """Write the pictures with one palette: successive ones then differ in little, and the file is small."""
    figure.set_dpi(DOTS)
    films = []
    for frame in range(frames):
        show(frame)
        figure.canvas.draw()
        films.append(Image.fromarray(np.asarray(figure.canvas.buffer_rgba())).convert("RGB"))  # type: ignore[attr-defined]
    some = films[:: max(1, frames // 6)]
    sample = Image.new("RGB", (some[0].width, some[0].height * len(some)))
    for i, film in enumerate(some):
        sample.paste(film, (0, i * film.height))
    palette = sample.quantize(COLOURS_OF_GIF)
    first, *others = (film.quantize(palette=palette, dither=Image.Dither.NONE) for film in films)
    first.save(target, save_all=True, append_images=others, duration=round(1000 / PACE), loop=0, optimize=True)


def check_target(path: str | Path) -> Path:
    """Return the path of an animation; raise `ModelError` where it cannot be written."""
    target = as_path("animate: path", path)
    if target.suffix not in FORMS:
        raise ModelError(f"animate: got the path {str(target)!r}; give one that ends in .gif or .mp4.")
    if not target.parent.is_dir():
        raise ModelError(f"animate: the directory {str(target.parent)!r} does not exist; make it.")
    if target.suffix == ".mp4" and not animation.writers.is_available("ffmpeg"):
        raise ModelError("animate: .mp4 asks for the program ffmpeg, which is not found; install it, or take .gif.")
    return target


def _sampled(motion: Orbit | Trajectory, t: Array, order: int) -> Array:
    """Return coordinates or velocities at the times t [s], shape (len(t), n)."""
    if isinstance(motion, Orbit):
        return motion.v(t) if order else motion.q(t)
    known = motion.v if order else motion.q
    return np.array([np.interp(t, motion.t, column) for column in known.T]).T


def _with_sketch(motion: Orbit | Trajectory) -> tuple[Figure, NDArray[Any]]:
    """Return a figure with the sketch above a phase portrait and a time history."""
    with style():
        figure = plt.figure(figsize=(8.4, 5.6), layout="constrained")
        layout = figure.add_gridspec(2, 2, height_ratios=[1.25, 1], width_ratios=[1, 1.5])
        grid = np.array([[figure.add_subplot(layout[1, 0]), figure.add_subplot(layout[1, 1])]])
        figure.add_subplot(layout[0, :])
    figure.suptitle(title_of(motion), x=0.02, ha="left", fontsize=10.5)
    for ax in grid.flat:
        ax.grid(True, color=PALE, linewidth=0.7)
    return figure, grid


def _colour(motion: Orbit | Trajectory) -> str:
    judged = motion.stability if isinstance(motion, Orbit) else None
    return SHADES[judged.verdict] if judged else SHADES["unknown"]


def _moving_dot(ax: Axes, curve: tuple[Array, Array], stops: tuple[Array, Array], colour: str) -> Redraw:
    """Draw a curve and a dot that stops at points of it; return what moves the dot."""
    ax.plot(*curve, color=colour, lw=1.6)
    (dot,) = ax.plot([], [], "o", color=INK, ms=7)
    x, y = stops

    def redraw(frame: int) -> list[Any]:
        dot.set_data([x[frame]], [y[frame]])
        return [dot]

    return redraw


def _drawing(ax: Axes, motion: Orbit | Trajectory, sketch: Sketch, here: Array) -> Redraw:
    """Draw the shapes of a sketch, in a frame that holds all of them at any time."""

    def shapes(row: Array) -> Any:
        return sketch(dict(zip(motion.coordinates, map(float, row), strict=True)), dict(motion.parameters))

    films = [shapes(row) for row in here]
    lines = [ax.plot(s.x, s.y, solid_capstyle="round", **LOOKS[s.kind])[0] for s in films[0]]
    x, y = (np.concatenate([np.ravel(getattr(s, axis)) for film in films for s in film]) for axis in "xy")
    ax.set(xlim=(x.min() - MARGIN, x.max() + MARGIN), ylim=(y.min() - MARGIN, y.max() + MARGIN))
    ax.set_aspect("equal")
    ax.axis("off")
    if sketch.__doc__:
        ax.set_title(sketch.__doc__.strip().splitlines()[0], fontsize=9)

    def redraw(frame: int) -> list[Any]:
        for line, shape in zip(lines, films[frame], strict=True):
            line.set_data(shape.x, shape.y)
            if shape.kind == "contact":
                line.set(**(LIT if shape.lit else LOOKS["contact"]))
        return lines

    return redraw
