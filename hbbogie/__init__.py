"""Limit cycles of self-excited mechanical systems as nonlinear programs.

System -> Equations -> Orbit -> Branch: each a value; verbs are functions. See the documentation for a
tutorial; `hbbogie.plot` draws results and is imported only when asked for.
"""

from hbbogie.attraction import Attraction, measure_attraction
from hbbogie.basin import find_basin
from hbbogie.charts import chart
from hbbogie.comparison import compare
from hbbogie.continuation import trace
from hbbogie.critical import critical_speeds, fold
from hbbogie.cycles import find_cycles
from hbbogie.design import optimise
from hbbogie.elements import Element
from hbbogie.errors import ConvergenceError, ModelError
from hbbogie.guesses import hopf_points
from hbbogie.hysteresis import find_hysteresis
from hbbogie.identification import Parametrisation, identify
from hbbogie.integration import simulate
from hbbogie.laws import Backlash, CoulombFriction, Cubic, DeadBand, Friction, Polynomial, Saturation, Step, Tabulated
from hbbogie.methods.describing import describing_function
from hbbogie.methods.describing_equations import DescribingFunction
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.problem import load_problem
from hbbogie.ramp import simulate_ramp
from hbbogie.results import Basin, Branch, Chart, Hysteresis, Orbit, Passage, SpecialPoint, Stability, Trajectory
from hbbogie.settling import last_orbit, settle
from hbbogie.solvers import solve
from hbbogie.stability import floquet
from hbbogie.studies.sweep import sweep
from hbbogie.system import Coordinate, Parameter, System
from hbbogie.verification import verify

__version__ = "0.1.0"

__all__ = [
    "Attraction",
    "Backlash",
    "Basin",
    "Branch",
    "Chart",
    "ConvergenceError",
    "Coordinate",
    "CoulombFriction",
    "Cubic",
    "DeadBand",
    "DescribingFunction",
    "Element",
    "Friction",
    "HarmonicBalance",
    "Hysteresis",
    "ModelError",
    "Orbit",
    "Parameter",
    "Parametrisation",
    "Passage",
    "Polynomial",
    "Saturation",
    "SpecialPoint",
    "Stability",
    "Step",
    "System",
    "Tabulated",
    "Trajectory",
    "chart",
    "compare",
    "critical_speeds",
    "describing_function",
    "find_basin",
    "find_cycles",
    "find_hysteresis",
    "floquet",
    "fold",
    "hopf_points",
    "identify",
    "last_orbit",
    "load_problem",
    "measure_attraction",
    "optimise",
    "settle",
    "simulate",
    "simulate_ramp",
    "solve",
    "sweep",
    "trace",
    "verify",
]
