"""Work in several processes: their number, one thread of linear algebra in each, Ctrl-C, and time limits.

Basins and studies submit calls and receive results. Computations of independent parts, such as branches, pass them to
`each`, which does them in this process unless `in_processes` around it asks for several. A worker ends with its parent.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
