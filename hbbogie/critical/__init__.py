"""Critical values of a parameter: folds and Hopf points with gradients, and charts of them over two parameters.

A `System` or a guess goes in. A `Critical` comes out: the value with its derivatives in all other parameters.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
