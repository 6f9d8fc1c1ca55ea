"""Damages pictures in every way that a cable, a disk or a camera can, and reads them.

`python -m tests.vision.cameras.damaging SEED COUNT BLACK_BOX` reads COUNT of them and prints what
came of it as JSON. The picture in hand is in the file BLACK_BOX, whatever happens to this process.
"""

from __future__ import annotations

import json
import mmap
import random
import resource
import sys
import zlib
from collections import Counter
from pathlib import Path

import cv2
import numpy as np

from tests.vision.tracking.synthetic import HEIGHT_M, Look, Robot, render
from vsense.base.arena import Image
from vsense.vision.cameras.camera import Camera
from vsense.vision.cameras.picture import PictureError, decode, to_grey
from vsense.vision.markers.families import load_family
from vsense.vision.tracking._detector import make_detector

SIZE = (96, 72)
CAMERA = Camera.looking_down("a", 0.0, 0.0, 0.6, 260.0, SIZE)
FAMILY = load_family("arrow4x4")
BOX_BYTES = 1 << 16
MEMORY = 1 << 30
"""So much address space a picture may cost on top of what the process has before the first."""

_SEGMENTS = b"\xff\xd8\xff\xc0\xff\xc2\xff\xc4\xff\xda\xff\xdb\xff\xd9\xff\xdd\xff\xe1\xff\x00"


def originals() -> list[bytes]:
    """Good pictures of a marker, in the forms that cameras and files have."""
    grey = render(CAMERA, FAMILY, [Robot(1, 0.0, 0.0, 0.7)], Look(litter=2), seed=1)
    colour = cv2.merge([grey, cv2.flip(grey, 0), cv2.flip(grey, 1)])
    forms: list[tuple[str, np.ndarray, tuple[int, ...]]] = [
        (".jpg", grey, (cv2.IMWRITE_JPEG_QUALITY, 90)),
        (".jpg", grey, (cv2.IMWRITE_JPEG_QUALITY, 40)),
        (".jpg", colour, ()),
        (".jpg", colour, (cv2.IMWRITE_JPEG_PROGRESSIVE, 1)),
        (".jpg", grey, (cv2.IMWRITE_JPEG_RST_INTERVAL, 3)),
        (".png", grey, ()),
        (".png", colour, ()),
        (".png", grey.astype(np.uint16) * 257, ()),
    ]
    return [bytes(cv2.imencode(form, image, params)[1]) for form, image, params in forms]


def damage(whole: bytes, other: bytes, chance: random.Random) -> bytes:
    """Damages a picture once or a few times."""
    ways = [_cut, _cut_and_end, _bytes, _bytes, _bytes, _lose, _insert, _repeat, _splice, _segment]
    if whole[1:4] == b"PNG":
        ways += [_chunk, _chunk, _chunk, _pixels, _pixels]
    elif chance.random() < 0.02:
        ways = [_size]
    data = bytearray(whole)
    for _ in range(chance.choice((1, 1, 1, 2, 4))):
        data = chance.choice(ways)(data, other, chance) or bytearray(b"\0")
    return bytes(data)


def _cut(data: bytearray, _: bytes, chance: random.Random) -> bytearray:
    return data[: chance.randrange(len(data))]


def _cut_and_end(data: bytearray, _: bytes, chance: random.Random) -> bytearray:
    """Cuts it off, and leaves the end that a whole picture has."""
    return data[: chance.randrange(len(data))] + data[-12:]


def _bytes(data: bytearray, _: bytes, chance: random.Random) -> bytearray:
    for _unused in range(chance.choice((1, 1, 3, 20))):
        data[chance.randrange(len(data))] = chance.choice((0, 1, 0x7F, 0xFF, chance.randrange(256)))
    return data


def _lose(data: bytearray, _: bytes, chance: random.Random) -> bytearray:
    place = chance.randrange(len(data))
    del data[place : place + chance.choice((1, 16, 200))]
    return data


def _insert(data: bytearray, _: bytes, chance: random.Random) -> bytearray:
    place = chance.randrange(len(data))
    data[place:place] = chance.randbytes(chance.choice((1, 16, 200)))
    return data


def _repeat(data: bytearray, _: bytes, chance: random.Random) -> bytearray:
    place, length = chance.randrange(len(data)), chance.choice((4, 64, 500))
    data[place:place] = data[place : place + length]
    return data


def _splice(data: bytearray, other: bytes, chance: random.Random) -> bytearray:
    """Goes on in another picture, as where two packets were mixed up."""
    return data[: chance.randrange(len(data))] + other[chance.randrange(len(other)) :]


def _segment(data: bytearray, _: bytes, chance: random.Random) -> bytearray:
    """Puts a JPEG's marker where none was, or damages what follows one."""
    place = data.find(b"\xff", chance.randrange(len(data)))
    if place < 0 or chance.random() < 0.3:
        place, start = chance.randrange(len(data)), 2 * chance.randrange(len(_SEGMENTS) // 2)
        data[place : place + 2] = _SEGMENTS[start : start + 2]
        return data
    place = min(place + chance.randrange(1, 12), len(data) - 1)
    data[place] = chance.randrange(256)
    return data


def _size(data: bytearray, _: bytes, chance: random.Random) -> bytearray:
    """Claims another size in a JPEG's header."""
    place = max(data.find(b"\xff\xc0"), data.find(b"\xff\xc2"))
    data[place + 5 : place + 9] = chance.randbytes(4)
    return data


def _chunk(data: bytearray, _: bytes, chance: random.Random) -> bytearray:
    """Damages a chunk of a PNG, with a checksum that fits."""
    places = [data.find(name) for name in (b"IHDR", b"IDAT", b"IHDR", b"IEND")]
    place = max(chance.choice(places), 12)
    length = min(int.from_bytes(data[place - 4 : place], "big"), len(data) - place - 8)
    if length < 1:
        return data
    for _unused in range(chance.choice((1, 2, 8))):
        data[place + 4 + chance.randrange(length)] = chance.randrange(256)
    check = zlib.crc32(data[place : place + 4 + length])
    data[place + 4 + length : place + 8 + length] = check.to_bytes(4, "big")
    return data


def _pixels(data: bytearray, _: bytes, chance: random.Random) -> bytearray:
    """Damages what a PNG's filters work on, with all else as it should be."""
    place = data.find(b"IDAT")
    length = int.from_bytes(data[place - 4 : place], "big") if place >= 4 else 0
    try:
        rows = bytearray(zlib.decompress(data[place + 4 : place + 4 + length]))
    except zlib.error:
        return data
    rows = _bytes(rows, b"", chance) if rows else rows
    body = b"IDAT" + zlib.compress(rows[: len(rows) - chance.choice((0, 0, 1, 500))], 1)
    check = zlib.crc32(body).to_bytes(4, "big")
    head = (len(body) - 4).to_bytes(4, "big")
    return data[: place - 4] + head + body + check + data[place + 8 + length :]


def raw_frame(whole: Image, chance: random.Random) -> np.ndarray:
    """A frame as a driver might hand it over: too short, too long, of another kind, or noise."""
    kind = chance.choice((np.uint8, np.uint8, np.uint8, np.uint16, np.int8, np.float32))
    channels = chance.choice((0, 0, 0, 1, 2, 3, 4, 5))
    height, width = whole.shape
    if chance.random() < 0.2:
        height, width = chance.randrange(200), chance.randrange(200)
    shape = (height, width, channels) if channels else (height, width)
    data = np.frombuffer(_bytes(bytearray(whole.tobytes()), b"", chance), np.uint8)
    frame = np.resize(np.roll(data, chance.choice((0, 0, 7, 5000))), shape).astype(kind)
    return frame[:, ::-1] if chance.random() < 0.2 else frame


class Reader:
    """Reads damaged pictures and looks for markers in them."""

    def __init__(self, box: mmap.mmap) -> None:
        self.counts: Counter[str] = Counter()
        self._box = box
        self._originals = originals()
        self._whole = decode(self._originals[0], "a")
        self._detector = make_detector(FAMILY, [1, 2, 3], HEIGHT_M)
        assert list(self._detector.detect(self._whole, CAMERA)["tag"]) == [1]

    def read(self, seed: int, number: int) -> None:
        """Makes the picture of this number, and reads it."""
        chance = random.Random(seed * 1_000_003 + number)
        try:
            if number % 10 == 0:
                frame = raw_frame(self._whole, chance)
                self._note(seed, number, frame.tobytes())
                image = to_grey(frame)
            else:
                data = damage(*chance.choices(self._originals, k=2), chance)
                self._note(seed, number, data)
                image = decode(data, "a")
        except PictureError:
            self.counts["refused"] += 1
            return
        assert image.dtype == np.uint8 and image.ndim == 2 and image.size > 0
        self.counts["read"] += 1
        if image.shape == SIZE[::-1]:
            self.counts["searched"] += 1
            self.counts["found"] += len(self._detector.detect(image, CAMERA)) > 0

    def _note(self, seed: int, number: int, data: bytes) -> None:
        head = f"seed {seed} number {number} length {len(data)}\n".encode()
        self._box[: len(head)] = head
        part = data[: BOX_BYTES - len(head)]
        self._box[len(head) : len(head) + len(part)] = part


def main(seed: int, count: int, path: Path) -> None:
    path.write_bytes(bytes(BOX_BYTES))
    with path.open("r+b") as file, mmap.mmap(file.fileno(), BOX_BYTES) as box:
        reader = Reader(box)
        in_use = int(Path("/proc/self/statm").read_text().split()[0]) * mmap.PAGESIZE
        resource.setrlimit(resource.RLIMIT_AS, (in_use + MEMORY, in_use + MEMORY))
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        for number in range(count):
            reader.read(seed, number)
        after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    print(json.dumps({**reader.counts, "grown_mb": (after - before) / 1024}))


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), Path(sys.argv[3]))
