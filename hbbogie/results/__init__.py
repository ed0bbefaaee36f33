"""Results as plain data: orbits, trajectories, stability, special points, branches, charts.

Everything here holds NumPy arrays, numbers and strings only. It pickles, saves to NetCDF and loads again without the
system or the solver that made it.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
