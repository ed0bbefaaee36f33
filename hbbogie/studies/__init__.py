"""Studies: one job at many parameter points, on any executor, into a store that survives.

`sweep` is the verb; `grid`, `latin_hypercube`, `sobol`, `random`, `saltelli`, `listed` and `from_csv` make the points.
What comes back is a labelled dataset, which `export` writes and `exceedance`, `sobol_indices` and `prediction` look
into.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
