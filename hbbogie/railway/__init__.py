"""Wheel and rail: creep laws, profiles, contact geometry and conicity.

Creep laws are used in equations of motion like the laws of `hbbogie.model`. Profiles and contact geometry are in
millimetres, as in drawings and standards; everything else is in SI units.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
