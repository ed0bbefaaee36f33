"""Design: parameters that raise the critical speed, their robustness, and parameters identified from measured cycles.

A `System`, a range for each free parameter, and limits go in. A `Design` with its evidence comes out.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
