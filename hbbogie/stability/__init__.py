"""Stability of cycles: Floquet multipliers with a verdict, and cycles polished by shooting.

A `System` and an `Orbit` go in. `floquet` and `hill` give a verdict, which may be "unknown", with its reason. `verify`
gives the polished cycle and the error bars of the given one.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
