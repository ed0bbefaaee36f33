"""Stability of cycles: Floquet multipliers with a verdict, and cycles made exact by shooting.

A `System` and an `Orbit` go in. `floquet` and `hill` give a verdict with its reason, "unknown" among them; `verify`
gives the polished cycle and the error bars of the one it came from.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
