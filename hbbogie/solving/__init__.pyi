from .arclength import Curve as Curve
from .arclength import walk as walk
from .expressions import Cycle as Cycle
from .expressions import CycleFunction as CycleFunction
from .expressions import CycleLimit as CycleLimit
from .optimum import Optimum as Optimum
from .optimum import minimise as minimise
from .solvers import solve as solve
