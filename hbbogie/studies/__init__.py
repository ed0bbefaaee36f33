"""Studies: one job at many parameter points, on any executor, with a store that survives a crash.

`sweep` runs a study. `grid`, `latin_hypercube`, `sobol`, `random`, `saltelli`, `listed` and `from_csv` make its points.
The result is a labelled dataset, which `export` writes and `exceedance`, `sobol_indices` and `prediction` evaluate.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
