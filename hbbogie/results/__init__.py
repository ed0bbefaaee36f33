"""Results as plain data: orbits, trajectories, stability, special points, branches, charts.

Everything here contains only NumPy arrays, numbers and strings. It can be pickled, saved to NetCDF and loaded again
without the system or the solver that made it.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
