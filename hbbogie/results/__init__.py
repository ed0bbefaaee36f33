"""Results as plain data: orbits, trajectories, stability, special points, branches, charts.

Everything here holds NumPy arrays, numbers and strings only: it pickles, saves to NetCDF and loads
again without the system or the solver that made it.
"""

from hbbogie.results.basin import Basin
from hbbogie.results.branch import Branch, SpecialPoint
from hbbogie.results.chart import Chart, ChartPoint, CriticalCurve
from hbbogie.results.critical import Critical
from hbbogie.results.hysteresis import Hysteresis, Passage
from hbbogie.results.orbit import Orbit, Stability
from hbbogie.results.trajectory import Trajectory

__all__ = [
    "Basin",
    "Branch",
    "Chart",
    "ChartPoint",
    "Critical",
    "CriticalCurve",
    "Hysteresis",
    "Orbit",
    "Passage",
    "SpecialPoint",
    "Stability",
    "Trajectory",
]
