"""The explorer: a page on this machine with a slider for every parameter, and the diagram that follows them.

What a session shows is a value, a `View`. Pure functions make the diagram, the cycles and the files of a session from
it. The server answers the page with them and holds nothing but what was computed last.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
