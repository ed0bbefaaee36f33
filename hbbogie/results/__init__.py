"""Results as plain data: orbits, trajectories, stability, special points, branches, charts.

Everything here holds NumPy arrays, numbers and strings only: it pickles, saves to NetCDF and loads
again without the system or the solver that made it.
"""

from hbbogie.results.basin import Basin
from hbbogie.results.branch import Branch, SpecialPoint
from hbbogie.results.chart import Chart, ChartPoint, CriticalCurve
from hbbogie.results.orbit import Orbit, Stability
from hbbogie.results.trajectory import Trajectory

__all__ = ["Branch", "Chart", "ChartPoint", "CriticalCurve", "Orbit", "SpecialPoint", "Stability", "Trajectory"]
from hbbogie.results.hysteresis import Hysteresis, Passage
from hbbogie.results.orbit import Orbit, Stability
from hbbogie.results.trajectory import Trajectory

__all__ = ["Basin", "Branch", "Hysteresis", "Orbit", "Passage", "SpecialPoint", "Stability", "Trajectory"]
