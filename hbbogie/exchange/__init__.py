"""Systems and cycles in the form of other programs, to check a result there or to carry it on.

A `System`, a cycle of it and a parameter go in. The files of the other program come out, as text.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
