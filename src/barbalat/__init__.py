"""Design, certify, simulate and deploy adaptive controllers, and find out which claims about them are true.

The public names stand in ``__init__.pyi``; each is imported when it is first used, so that ``import barbalat`` is fast.
"""

import lazy_loader

__version__ = "0.1.0"
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
