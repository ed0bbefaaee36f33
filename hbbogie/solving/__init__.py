"""Solving: Newton's method, one nonlinear program for IPOPT, and one engine for curves of solutions.

`Equations` and a guess go in; an `Orbit` comes out, or an `Optimum` where something is minimised.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
