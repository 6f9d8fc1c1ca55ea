"""vsense: virtual sensing for real robots."""

from vsense import _moved

__version__ = "0.1.0"

_moved.install()
