"""Branches of cycles: continuation, special points, branch switching, and all cycles at a parameter value.

`Equations` and a start, an `Orbit` or a `SpecialPoint`, go in. A `Branch` of orbits with stability comes out.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
