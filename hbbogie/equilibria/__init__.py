"""Equilibria over a parameter: where they are, their eigenvalues, and the Hopf points at which cycles begin.

A `System` goes in. Hopf points come out as `SpecialPoint`, from which `trace` and `fold` can start.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
