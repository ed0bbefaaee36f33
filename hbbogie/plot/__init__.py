"""Figures of results. Functions take results and optional axes ``ax``, and return the axes.

The only module that imports matplotlib. The style is set for the figures made here, not for the session.
"""

from hbbogie.plot.appearance import figure_of, one_legend, panels, save, style
from hbbogie.plot.branches import branch, frequency, multipliers, multipliers_along
from hbbogie.plot.charts import chart, coexistence, coexistence_width
from hbbogie.plot.design import gains, scatter
from hbbogie.plot.motions import basin, delays, hysteresis
from hbbogie.plot.orbits import orbit, spectrum, time_history, waveform
from hbbogie.plot.studies import (
    distribution,
    drawing,
    parallel_coordinates,
    parameter_map,
    prediction,
    sample_scatter,
    sensitivity,
)

__all__ = [
    "basin",
    "branch",
    "chart",
    "coexistence",
    "coexistence_width",
    "delays",
    "distribution",
    "drawing",
    "figure_of",
    "frequency",
    "gains",
    "hysteresis",
    "multipliers",
    "multipliers_along",
    "one_legend",
    "orbit",
    "panels",
    "parallel_coordinates",
    "parameter_map",
    "prediction",
    "sample_scatter",
    "save",
    "scatter",
    "sensitivity",
    "spectrum",
    "style",
    "time_history",
    "waveform",
]
