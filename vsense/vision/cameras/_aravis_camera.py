"""A camera that Aravis has opened: its features, its control, its trigger.

Its pictures are not copied: each is a buffer of the driver. When the last reference to a picture is
gone, its buffer goes back to be filled again.
"""

from __future__ import annotations

import ipaddress
import threading
from pathlib import Path
from typing import Any

import numpy as np

from vsense.base.arena import Image
from vsense.base.errors import failing_as
from vsense.vision.cameras._networks import (
    CONTROL,
    IN_CONTROL,
    accept_only,
    answers,
    host_address,
    several,
)
from vsense.vision.cameras.aravis import AravisError, call, listed, load
from vsense.vision.cameras.picture import PictureError

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
            # Aravis takes anybody's packets for its camera's, and rubbish can end the program: it
            # asks for as much memory as a packet says. Source: Aravis 0.8.26, arvgvstream.c.
            with failing_as(AravisError, "its port is open to all"):
                accept_only(camera.name, self._lib.arv_gv_stream_get_port(stream))
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


_CHECK_RANGES = 1
_NEVER_ADJUST = 0
"""The packet size is chosen once, before a stream is made."""
_NO_PACKET_SOCKET = 1
_opening = threading.Lock()
"""Aravis parses all descriptions in shared memory. Source: its 0.8.26, arvdomparser.c."""


def locate(name: str) -> str:
    """Searches for a camera; returns its IPv4 address (GigE) or its id (USB3).

    Args:
        name: An IPv4 address, or an id, a serial number or a MAC address as `listed` has them.

    Raises:
        AravisError: No camera answers to the name, or several share its name or address.
    """
    there = listed()
    matches = [camera for camera in there if name in camera.names]
    if not matches and is_address(name):
        # The search does not reach cameras behind a router; they can still be opened.
        return name
    if not matches:
        ids = ", ".join(camera.id for camera in there) or "none"
        raise AravisError(f"no camera answers to {name!r}; there are: {ids}")
    addresses = {camera.address for camera in matches} - {""}
    same = [c for c in there if c.address in addresses] if addresses else matches
    if len(same) > 1:
        what = f"the address {same[0].address}" if addresses else f"the name {name!r}"
        raise AravisError(several(what, same))
    return matches[0].address or matches[0].id


def is_address(name: str) -> bool:
    """Whether a camera's name is an IPv4 address."""
    try:
        return ipaddress.ip_address(name).version == 4
    except ValueError:
        return False


class AravisCamera:
    """An opened camera, for one thread; only `trigger` may be called from another."""

    def __init__(self, name: str) -> None:
        """Opens a camera as `locate` names it, with control if it is free; raises AravisError."""
        self._lib, self._ffi = load().lib, load().ffi
        self.name, self.is_gige = name, is_address(name)
        if self.is_gige and not answers(name):
            # Aravis would wait for seconds, and all other cameras with it.
            raise AravisError(f"no camera answers at {name}")
        with _opening:
            device = self._gige_device(name) if self.is_gige else None
            self.handle = self._owned(
                call(self._lib.arv_camera_new, name.encode())
                if device is None
                else call(self._lib.arv_camera_new_with_device, device)
            )
        self._device = self._lib.arv_camera_get_device(self.handle)
        self._lib.arv_device_set_range_check_policy(self._device, _CHECK_RANGES)
        if self.is_gige:
            self._lib.arv_gv_device_set_packet_size_adjustment(self._device, _NEVER_ADJUST)

    @property
    def in_control(self) -> bool:
        """Whether the camera obeys this program; raises AravisError if it does not answer."""
        if not self.is_gige:
            return True
        if not self._lib.arv_gv_device_is_controller(self._device):
            return False
        if not self.answers:
            raise AravisError(f"no camera answers at {self.name}")
        value = self._ffi.new("uint32_t *")
        call(self._lib.arv_device_read_register, self._device, CONTROL, value)
        return bool(value[0] & IN_CONTROL)

    def has(self, feature: str) -> bool:
        """Whether the camera has a feature now; some depend on other features."""
        available = self._lib.arv_device_is_feature_available
        return bool(call(available, self._device, feature.encode()))

    def get(self, feature: str) -> str:
        """Reads a feature of any type; raises AravisError if it is missing or refused."""
        text = call(self._lib.arv_gc_feature_node_get_value_as_string, self._node(feature))
        return self._ffi.string(text).decode(errors="replace") if text else ""

    def set(self, feature: str, value: str) -> None:
        """Writes a feature, which may be rounded; raises AravisError if missing or refused."""
        write = self._lib.arv_gc_feature_node_set_value_from_string
        call(write, self._node(feature), value.encode())

    def bounds(self, feature: str) -> tuple[float, float] | None:
        """Returns the least and the greatest value of a number; None: unknown."""
        for kind, ask in (
            ("double", self._lib.arv_device_get_float_feature_bounds),
            ("int64_t", self._lib.arv_device_get_integer_feature_bounds),
        ):
            low, high = self._ffi.new(f"{kind} *"), self._ffi.new(f"{kind} *")
            try:
                call(ask, self._device, feature.encode(), low, high)
            except AravisError:
                continue
            return float(low[0]), float(high[0])
        return None

    def formats(self) -> list[str]:
        """Returns the names of the pixel formats."""
        count = self._ffi.new("unsigned *")
        names = call(
            self._lib.arv_camera_dup_available_pixel_formats_as_strings, self.handle, count
        )
        formats = [self._ffi.string(names[n]).decode() for n in range(count[0])]
        self._lib.g_free(names)
        return formats

    @property
    def rate_hz(self) -> float:
        """Pictures per second; the feature has several names."""
        return float(call(self._lib.arv_camera_get_frame_rate, self.handle))

    def set_rate(self, rate_hz: float) -> None:
        """Sets the rate within the camera's bounds; switches triggers off."""
        call(self._lib.arv_camera_set_frame_rate, self.handle, rate_hz)

    def set_trigger(self, source: str | None) -> None:
        """Sets the trigger source, "Software" or a line; None: runs freely."""
        if source is None:
            call(self._lib.arv_camera_clear_triggers, self.handle)
        else:
            call(self._lib.arv_camera_set_trigger, self.handle, source.encode())

    def trigger(self) -> None:
        """Triggers a picture; any thread; does nothing after `close`; raises AravisError."""
        handle = self.handle
        if handle is not None:
            call(self._lib.arv_camera_software_trigger, handle)

    def use_plain_socket(self) -> None:
        """Has the stream come through an ordinary UDP socket, not a packet socket."""
        self._lib.arv_gv_device_set_stream_options(self._device, _NO_PACKET_SOCKET)

    @property
    def answers(self) -> bool:
        """Whether the camera answers at once; Aravis would wait for seconds."""
        return not self.is_gige or answers(self.name)

    @property
    def packet_size(self) -> int:
        """Bytes of a packet of its stream, with IP and UDP headers."""
        return int(call(self._lib.arv_camera_gv_get_packet_size, self.handle))

    def set_packets(self, size: int | None, delay_us: float | None) -> None:
        """Sets bytes per packet and the pause between two packets.

        None stands for the largest packet that gets through, and for the camera's own pause.
        """
        if size is None:
            call(self._lib.arv_camera_gv_auto_packet_size, self.handle)
        else:
            call(self._lib.arv_camera_gv_set_packet_size, self.handle, size)
        if delay_us is not None:
            delay_ns = round(1e3 * delay_us)
            call(self._lib.arv_camera_gv_set_packet_delay, self.handle, delay_ns)

    @property
    def packet_delay_us(self) -> float:
        """Pause between two packets."""
        return float(call(self._lib.arv_camera_gv_get_packet_delay, self.handle)) / 1e3

    def stop(self) -> None:
        """Stops the pictures that a crashed program may have left running."""
        call(self._lib.arv_camera_stop_acquisition, self.handle)

    def close(self) -> None:
        """Closes the camera and gives control back; can be called again.

        A thread that is triggering it holds it until its call returns.
        """
        self._device = self.handle = None

    def _gige_device(self, address: str) -> Any:
        """Opens by address, without Aravis' search, for which other cameras would wait."""
        host = host_address(address)
        if host is None:
            raise AravisError(f"no network of this machine leads to {address}")
        make = self._lib.g_inet_address_new_from_string
        ends = [self._owned(make(end.encode())) for end in (host, address)]
        return self._owned(call(self._lib.arv_gv_device_new, *ends))

    def _owned(self, thing: Any) -> Any:
        if not thing:
            raise AravisError("the camera does not open")
        return self._ffi.gc(thing, self._lib.g_object_unref)

    def _node(self, feature: str) -> Any:
        node = self._lib.arv_device_get_feature(self._device, feature.encode())
        if not node:
            raise AravisError(f"there is no feature {feature}")
        return node
