from .arclength import Curve as Curve
from .arclength import walk as walk
from .optimum import Cycle as Cycle
from .optimum import Optimum as Optimum
from .optimum import minimise as minimise
from .solvers import solve as solve
