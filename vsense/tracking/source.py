"""The seam behind which every kind of live camera stands: open, read, close, perhaps trigger."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from vsense.tracking.grabbers_picture import Image


@dataclass(frozen=True, slots=True)
class Shot:
    """A picture as a camera hands it over.

    Attributes:
        image: (h, w) uint8; the memory may be the driver's own, and stays valid as long as
            anybody refers to it.
        stamp_ns: When it was taken by the camera's own clock, whatever its zero; None: it has none.
        arrived_ns: When its first bytes reached the host, by the host's monotonic clock; None:
            nobody noted it.
    """

    image: Image
    stamp_ns: int | None = None
    arrived_ns: int | None = None


class Source(Protocol):
    """One camera; belongs to one thread."""

    def open(self) -> list[str]:
        """Opens it, or takes up again what was interrupted, and sets what it was asked for.

        Returns:
            What the camera made of that where it is not what was asked for: a text for each
            setting that it refused or rounded, such as "does not take gain_raw 99".

        Raises:
            GrabberError: It does not open.
        """

    def read(self) -> Shot:
        """Waits for the next picture.

        Raises:
            PictureError: The picture cannot be used; the next one may be good.
            GrabberError: The camera is gone, or silent for too long.
        """

    def close(self) -> None:
        """Lets it go; can be called again."""
