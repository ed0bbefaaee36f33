"""Attraction: which motions die out, which settle to a cycle, and how fast.

A `System` with its cycles goes in. A `Basin`, a `Hysteresis` or an `Attraction` comes out.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
