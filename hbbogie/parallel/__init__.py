"""Work in several processes: how many, one thread of linear algebra in each, Ctrl-C, and limits of time.

Basins and studies hand calls to it and take results back. A worker ends with its parent.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
