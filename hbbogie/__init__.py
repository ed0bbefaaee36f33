"""Limit cycles of self-excited mechanical systems as nonlinear programs.

System -> Equations -> Orbit -> Branch: each a value; verbs are functions. See the documentation for a
tutorial; `hbbogie.plot` draws results and is imported only when asked for.
"""

from hbbogie.comparison import compare
from hbbogie.continuation import trace
from hbbogie.critical import critical_speeds, fold
from hbbogie.cycles import find_cycles
from hbbogie.design import optimise
from hbbogie.elements import Element
from hbbogie.errors import ConvergenceError, ModelError
from hbbogie.guesses import hopf_points
from hbbogie.identification import Parametrisation, identify
from hbbogie.integration import simulate
from hbbogie.laws import (
    Backlash,
    CoulombFriction,
    Cubic,
    DeadBand,
    Friction,
    Polynomial,
    Saturation,
    Tabulated,
)
from hbbogie.methods.describing import describing_function
from hbbogie.methods.describing_equations import DescribingFunction
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.problem import load_problem
from hbbogie.results import Branch, Orbit, SpecialPoint, Stability, Trajectory
from hbbogie.settling import last_orbit, settle
from hbbogie.solvers import solve
from hbbogie.stability import floquet
from hbbogie.system import Coordinate, Parameter, System
from hbbogie.verification import verify

__version__ = "0.1.0"

__all__ = [
    "Backlash",
    "Branch",
    "ConvergenceError",
    "Coordinate",
    "CoulombFriction",
    "Cubic",
    "DeadBand",
    "DescribingFunction",
    "Element",
    "Friction",
    "HarmonicBalance",
    "ModelError",
    "Orbit",
    "Parameter",
    "Parametrisation",
    "Polynomial",
    "Saturation",
    "SpecialPoint",
    "Stability",
    "System",
    "Tabulated",
    "Trajectory",
    "compare",
    "critical_speeds",
    "describing_function",
    "find_cycles",
    "floquet",
    "fold",
    "hopf_points",
    "identify",
    "last_orbit",
    "load_problem",
    "optimise",
    "settle",
    "simulate",
    "solve",
    "trace",
    "verify",
]
