"""Colours of the calibration's picture: how much was seen, how far off a corner is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vsense.pictures.canvas import Colour, Image

Floats = NDArray[np.float64]

_COOL = np.array((250.0, 246.0, 240.0))
_WARM = np.array((196.0, 158.0, 96.0))
_GOOD = np.array((150.0, 70.0, 20.0))
_BAD = np.array((40.0, 40.0, 226.0))


def heat(share: Floats) -> Image:
    """Colours of (h, w) values from 0, nearly white, to 1, blue."""
    share = np.clip(share, 0.0, 1.0)[..., np.newaxis]
    return np.asarray(np.rint(_COOL + (_WARM - _COOL) * share), dtype=np.uint8)


def alarm(share: float) -> Colour:
    """The colour of a residual, from 0, dark blue, to 1, red."""
    mixed = _GOOD + (_BAD - _GOOD) * min(max(share, 0.0), 1.0)
    return int(mixed[0]), int(mixed[1]), int(mixed[2])
