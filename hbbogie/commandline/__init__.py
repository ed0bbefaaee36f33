"""The command line: ``hbbogie COMMAND NAME ...``.

Arguments are read here, a job of `hbbogie.reports` is done, and its report is shown and written. Numerics and figures
load inside the commands only.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
