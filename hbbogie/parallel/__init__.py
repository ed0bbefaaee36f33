"""Work in several processes: their number, one thread of linear algebra in each, Ctrl-C, and time limits.

Basins and studies submit calls and receive results. A worker ends with its parent.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
