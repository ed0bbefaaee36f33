"""Reports: the results of a job as tables, branches and figures.

Each job takes a problem, a system and options and returns a `Report`, which the command line prints and writes.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
