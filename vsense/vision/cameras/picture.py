"""Turns what a file or a camera gives into a grey picture, or into one clear reason why not."""

from __future__ import annotations

import os
import re
from contextlib import suppress
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Image
from vsense.base.errors import GrabberError
from vsense.base.files import read_bytes

MOST_PICTURE_BYTES = 512 << 20
MOST_PICTURE_PIXELS = 50_000_000
"""More than any camera above an arena has; a picture then takes megabytes at most."""

_GREY = cv2.IMREAD_GRAYSCALE
_PNG = b"\x89PNG\r\n\x1a\n"
_JPEG, _BMP, _GIF, _WEBP = b"\xff\xd8", b"BM", b"GIF8", b"WEBPVP8"
_JPEG_END = b"\xff\xd9"
_BARE = (0x01, *range(0xD0, 0xD9))
"""JPEG markers without a segment. Source: ITU-T T.81, table B.1."""
_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""JPEG markers that begin a picture, with its size. Source: ITU-T T.81, table B.1."""
_BLANK = rb"(?:\s|#[^\r\n]*[\r\n])+"
_PNM = re.compile(rb"P[1-6]" + _BLANK + rb"(\d{1,9})" + _BLANK + rb"(\d{1,9})\s")
"""Source: Netpbm's pnm(5)."""

_Order = Literal["little", "big"]


class PictureError(GrabberError, ValueError):
    """A picture that cannot be used; the next one may be good."""


class LatePicture(PictureError):
    """A picture that came too long after the others of its timestep."""


def to_grey(image: NDArray[Any]) -> Image:
    """Returns the (h, w) uint8 grey picture of an OpenCV image, uint8 or uint16.

    It is (h, w) or (h, w, 1) grey, (h, w, 3) BGR or (h, w, 4) BGRA; raises PictureError otherwise.
    """
    if image.dtype == np.uint16:
        image = (image >> 8).astype(np.uint8)
    if image.dtype != np.uint8 or image.ndim not in (2, 3) or image.size == 0:
        raise PictureError(f"is no picture: {image.dtype} of shape {image.shape}")
    channels = 1 if image.ndim == 2 else image.shape[2]
    if channels == 1:
        return np.ascontiguousarray(image.reshape(image.shape[:2]), dtype=np.uint8)
    if channels not in (3, 4):
        raise PictureError(f"has {channels} channels, expected 1, 3 or 4")
    code = cv2.COLOR_BGR2GRAY if channels == 3 else cv2.COLOR_BGRA2GRAY
    return np.asarray(cv2.cvtColor(image, code), dtype=np.uint8)


def read_picture(path: Path, name: str = "") -> Image:
    """Reads a picture file as grey, (h, w) uint8; raises PictureError if it is unusable.

    `name` is what messages call it, by default the file's own, without its folder.
    """
    name = name or path.name
    try:
        data = read_bytes(path, MOST_PICTURE_BYTES)
    except OSError as error:
        raise PictureError(f"{name} cannot be read: {error.strerror}") from None
    return decode(data, name)


def decode(
    data: bytes, name: str, most_pixels: int = MOST_PICTURE_PIXELS, flags: int = _GREY
) -> NDArray[Any]:
    """Decodes all bytes of a picture file, called `name` in messages; by default to (h, w) uint8.

    A picture that claims more than `most_pixels` is refused before memory is spent on it: four
    damaged bytes can ask for 2 GB, and a few kilobytes unfold to them. What does not say its size
    as PNG, JPEG, BMP, PNM, TIFF, WebP or GIF do is no picture. `flags` are of `cv2.imdecode`.

    Raises:
        PictureError: It is cut off, too large, or is no picture; the message begins with `name`.
    """
    if not data:
        raise PictureError(f"{name} is empty")
    # Some versions of OpenCV silently fill the missing part of a picture with grey.
    if not _is_whole(data):
        raise PictureError(f"{name} is cut off after {len(data)} bytes")
    width, height = _claimed_size(data)
    if width * height > most_pixels:
        most = f"at most {most_pixels} pixels"
        raise PictureError(f"{name} claims to have {width} x {height} pixels, expected {most}")
    image: NDArray[Any] | None = None
    with suppress(cv2.error):
        if width * height:
            image = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), flags)
    if image is None:
        raise PictureError(f"{name} is no picture, or a damaged one")
    return image


def is_jpeg(data: bytes) -> bool:
    """Whether the data begins like a JPEG."""
    return data.startswith(_JPEG)


def _claimed_size(data: bytes) -> tuple[int, int]:
    """Width and height in the header of a picture; zeros where there is none."""
    if data.startswith(_PNG) and data[12:16] == b"IHDR":
        return _number(data, 16, 4), _number(data, 20, 4)
    if is_jpeg(data):
        return _jpeg_size(data)
    if data.startswith(_BMP) and _number(data, 14, 4, "little") != 12:  # 12: that of OS/2
        height = _number(data, 22, 4, "little")  # below zero where the first row is the highest
        return _number(data, 18, 4, "little"), min(height, (1 << 32) - height)
    if data.startswith(_GIF):
        return _number(data, 6, 2, "little"), _number(data, 8, 2, "little")
    if data.startswith((b"II*\0", b"MM\0*")):
        return _tiff_size(data, "little" if data.startswith(b"II") else "big")
    if data[8:15] == _WEBP:
        return _webp_size(data)
    text = _PNM.match(data[:4096])
    return (int(text[1]), int(text[2])) if text else (0, 0)


def _jpeg_size(data: bytes) -> tuple[int, int]:
    place = len(_JPEG)
    while (place := data.find(b"\xff", place)) >= 0:
        marker = data[place + 1] if place + 1 < len(data) else 0
        if marker in _FRAMES:
            return _number(data, place + 7, 2), _number(data, place + 5, 2)
        if marker == 0xFF:
            place += 1
        elif marker == 0 or marker in _BARE:
            place += 2
        else:
            place += 2 + max(2, _number(data, place + 2, 2))
    return 0, 0


def _tiff_size(data: bytes, order: _Order) -> tuple[int, int]:
    """Of the first picture, or of its tiles where these are larger. Source: TIFF 6.0, section 2."""
    begin = _number(data, 4, 4, order) + 2
    sizes = {256: 0, 257: 0, 322: 0, 323: 0}
    for place in range(begin, begin + 12 * _number(data, begin - 2, 2, order), 12):
        tag, length = _number(data, place, 2, order), 2 * _number(data, place + 2, 2, order) - 4
        if tag in sizes and length in (2, 4):  # of a number of 16 or 32 bits: kinds 3 and 4
            sizes[tag] = max(sizes[tag], _number(data, place + 8, length, order))
    return max(sizes[256], sizes[322]), max(sizes[257], sizes[323])


def _webp_size(data: bytes) -> tuple[int, int]:
    """Source: RFC 9649, sections 2.5 to 2.7, and RFC 6386, section 9.1."""
    kind = data[15:16]
    if kind == b"X":
        return _number(data, 24, 3, "little") + 1, _number(data, 27, 3, "little") + 1
    if kind == b"L":
        bits = _number(data, 21, 4, "little")
        return (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    return _number(data, 26, 2, "little") & 0x3FFF, _number(data, 28, 2, "little") & 0x3FFF


def _number(data: bytes, place: int, length: int, order: _Order = "big") -> int:
    return int.from_bytes(data[place : place + length], order)


def _is_whole(data: bytes) -> bool:
    """Whether a PNG or JPEG is complete; other formats are not checked.

    A little may follow its end: network cameras append line ends, others fill up.
    """
    if data.startswith(_PNG):
        # Chunk by chunk: OpenCV allocates what a chunk claims to hold, up to 2 GB.
        place = len(_PNG)
        while place + 12 <= len(data):
            name, place = data[place + 4 : place + 8], place + 12 + _number(data, place, 4)
            if name == b"IEND":
                return place <= len(data)
        return False
    if data.startswith(_JPEG):
        return _JPEG_END in data.rstrip(b"\0")[-64:]
    return True


ENDINGS = (".png", ".jpg", ".jpeg", ".pgm", ".ppm", ".bmp", ".tif", ".tiff", ".webp")


def pictures_in(folder: Path) -> list[str]:
    """Returns the names of a folder's pictures in natural order; raises GrabberError."""
    try:
        names = [
            p.name for p in folder.iterdir() if p.suffix.lower() in ENDINGS and os.path.isfile(p)
        ]
    except OSError as error:
        raise GrabberError(f"{folder}: cannot be read: {error.strerror}") from None
    return sorted(names, key=natural_order)


_DIGITS = re.compile(r"([0-9]+)")


def natural_order(name: str) -> tuple[object, ...]:
    """Sort key of names in which "a2" comes before "a10"."""
    parts = _DIGITS.split(name.lower())
    return tuple((int(p), "") if p.isdecimal() else (-1, p) for p in parts), name
