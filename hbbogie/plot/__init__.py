"""Figures of results: functions that take results and optional axes ``ax``, and return the axes.

The only wing that imports matplotlib. The style is set for the figures made here, not for the session.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
