"""Studies: one job at many parameter points, on any executor, into a store that survives.

`sweep` is the verb; `grid`, `latin_hypercube`, `sobol`, `random`, `saltelli`, `listed` and `from_csv` make the points;
what comes back is a labelled dataset, which `export` writes and `hbbogie.studies.statistics` looks into.
"""

from hbbogie.studies.dataset import export
from hbbogie.studies.distributions import named_distribution
from hbbogie.studies.sampling import (
    Points,
    around,
    from_csv,
    grid,
    latin_hypercube,
    listed,
    random,
    saltelli,
    sobol,
)
from hbbogie.studies.sweep import sweep

__all__ = [
    "Points",
    "around",
    "export",
    "from_csv",
    "grid",
    "latin_hypercube",
    "listed",
    "named_distribution",
    "random",
    "saltelli",
    "sobol",
    "sweep",
]
