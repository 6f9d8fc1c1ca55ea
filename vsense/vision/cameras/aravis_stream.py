"""Pictures of a camera that Aravis has opened, without copying: each is a buffer of the driver.

When the last reference to a picture is gone, its buffer goes back to be filled again.
"""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import numpy as np

from vsense.vision.cameras.aravis import AravisError, call, load
from vsense.vision.cameras.aravis_camera import AravisCamera
from vsense.vision.cameras.picture import Image, PictureError

BUFFERS = 8
"""For the driver, the camera's newest, the tracker, the double buffer, the world and recorders."""
WAITING = 2
"""Pictures that the socket's memory should hold; the system's usual 200 kB are less than one, and
net.core.rmem_max is its limit."""
KEEP_FREE = 2
"""With fewer buffers left to fill, a picture is copied and its buffer goes back at once."""

_WHOLE = 0
_DAMAGE = {
    1: "is empty",
    2: "has come in part: its packets stopped",
    3: "lacks packets",
    4: "has packets that are not its own",
    5: "is larger than the camera had said",
    7: "was broken off",
}
"""By Aravis' buffer status."""

_BYTE_FORMATS = (0x01080001, 0x01080008, 0x01080009, 0x0108000A, 0x0108000B)
"""Mono8 and the four Bayer formats of 8 bits. Source: GenICam PFNC 2.4."""
_MOST_WAITING = Path("/proc/sys/net/core/rmem_max")


def _scant(picture_bytes: int) -> str:
    """Warns of a system whose socket memory holds less than one picture; "": it holds more."""
    try:
        room_bytes = int(_MOST_WAITING.read_text())
    except (OSError, ValueError):
        return ""
    if room_bytes >= picture_bytes:
        return ""
    return f" (net.core.rmem_max is {room_bytes}, less than its {picture_bytes} bytes)"


class AravisStream:
    """Pictures of one camera from now on; for one thread."""

    def __init__(self, camera: AravisCamera) -> None:
        """Starts the camera; raises AravisError if it refuses or does not answer."""
        self._lib, self._ffi = load().lib, load().ffi
        self._camera = camera
        # The first picture may be cut off by the start of the stream: its damage is no fault.
        self._first = True
        # Pictures may outlive this object and be released by any thread.
        self._lock = threading.RLock()
        size = call(self._lib.arv_camera_get_payload, camera.handle)
        self._scant = _scant(size) if camera.is_gige else ""
        if camera.is_gige and not self._scant:
            # A packet socket of Aravis receives other cameras' packets until its filter is set; the
            # camera's own pictures may then be dropped as late for the next hundred pictures.
            # Source: Aravis 0.8.26, arvgvstream.c.
            camera.use_plain_socket()
        stream = call(
            self._lib.arv_camera_create_stream, camera.handle, self._ffi.NULL, self._ffi.NULL
        )
        if not stream:
            raise AravisError("gives no pictures: its stream does not open")
        self._stream: Any = self._ffi.gc(stream, self._lib.g_object_unref)
        if camera.is_gige:
            wanted = self._ffi.cast("int", WAITING * size)
            self._lib.g_object_set(stream, b"socket-buffer-size", wanted, self._ffi.NULL)
        for _ in range(BUFFERS):
            self._lib.arv_stream_push_buffer(stream, self._lib.arv_buffer_new_allocate(size))
        call(self._lib.arv_camera_start_acquisition, camera.handle)

    def read(self, timeout_s: float) -> tuple[Image, int, int] | None:
        """Waits for the next picture.

        Returns:
            The picture, its time by the camera's clock [ns], and the time since its first packet
            came [ns]; None: none came in `timeout_s`.

        Raises:
            PictureError: The picture is damaged.
        """
        buffer = self._lib.arv_stream_timeout_pop_buffer(self._stream, round(timeout_s * 1e6))
        if not buffer:
            return None
        status = self._lib.arv_buffer_get_status(buffer)
        if status != _WHOLE:
            self._give_back(buffer)
            if self._first:
                self._first = False
                return self.read(timeout_s)
            raise PictureError(f"a picture {_DAMAGE.get(status, 'is damaged')}{self._scant}")
        self._first = False
        age_ns = 1000 * self._lib.g_get_real_time()
        age_ns -= self._lib.arv_buffer_get_system_timestamp(buffer)
        stamp_ns = int(self._lib.arv_buffer_get_timestamp(buffer))
        return self._image(buffer), stamp_ns, age_ns

    def close(self) -> None:
        """Stops the camera; can be called again. Pictures in use stay valid."""
        with self._lock:
            stream, self._stream = self._stream, None
        if stream is not None:
            try:
                if self._camera.answers:
                    call(self._lib.arv_camera_stop_acquisition, self._camera.handle)
            finally:
                self._ffi.release(stream)

    def _image(self, buffer: Any) -> Image:
        """Wraps a buffer's memory as an (h, w) uint8 picture."""
        size, padding = self._ffi.new("size_t *"), self._ffi.new("int[2]")
        memory = self._lib.arv_buffer_get_data(buffer, size)
        width = self._lib.arv_buffer_get_image_width(buffer)
        height = self._lib.arv_buffer_get_image_height(buffer)
        self._lib.arv_buffer_get_image_padding(buffer, padding, padding + 1)
        kind = self._lib.arv_buffer_get_image_pixel_format(buffer)
        if kind not in _BYTE_FORMATS:
            self._give_back(buffer)
            raise PictureError(f"a picture has the pixel format {kind:#010x}, expected 8 bits")
        row = width + padding[0]
        if width <= 0 or height <= 0 or row * height > size[0]:
            self._give_back(buffer)
            raise PictureError(f"a picture of {width} x {height} px has only {size[0]} bytes")
        lent = self._ffi.gc(memory, lambda _: self._give_back(buffer))
        flat = np.frombuffer(self._ffi.buffer(lent, row * height), np.uint8)
        image = flat.reshape(height, row)[:, :width]
        return image.copy() if padding[0] or self._scarce() else image

    def _scarce(self) -> bool:
        """Whether so many buffers are lent that the camera might run out of them."""
        counts = self._ffi.new("int[2]")
        self._lib.arv_stream_get_n_buffers(self._stream, counts, counts + 1)
        return bool(counts[0] < KEEP_FREE)

    def _give_back(self, buffer: Any) -> None:
        with self._lock:
            if self._stream is not None:
                self._lib.arv_stream_push_buffer(self._stream, buffer)
            else:
                self._lib.g_object_unref(buffer)
