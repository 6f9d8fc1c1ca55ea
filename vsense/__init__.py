"""vsense: virtual sensing for real robots.

What people import is in `vsense.__all__`, and loaded when it is asked for (`vsense/api.py`).
"""

from vsense import _moved, api

TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any

    from vsense.api import *  # noqa: F403

__version__ = "0.1.0"
__all__ = api.__all__

_moved.install()


def __getattr__(name: str) -> "Any":
    return getattr(api, name)


def __dir__() -> "list[str]":
    return sorted({*globals(), *api.__all__})
