"""A GigE Vision camera that shows a picture: Aravis' own camera simulator, with our eyes in it.

    python -m tests.gige.scene_camera eth0 --serial S1 scene.npy

It prints "ready" when it serves, and then obeys lines on its standard input, each of which it
answers with "ok".

    freeze | thaw          the same bytes again and again, with new stamps
    black | white | normal its cap is on; far too much light; the picture again
    lose N                 N of 1000 packets never leave
    slow HZ                so many pictures a second from now on, whatever its registers said
    jump MS                its clock makes a jump
    quit
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import Any

import cffi
import cv2
import numpy as np

from tests.gige.gvcp import REGISTERS

AS_IT_IS_US = 8000
"""The exposure at which the picture is shown as it is, without gain."""
DECIBEL = 10.0 ** (1.0 / 20.0)
"""One step of the gain."""
TICKS_HZ = 100.0
"""A camera that waits for a software trigger looks for it so often, on the beat of the clock."""
NOISES = 8
"""A sensor never gives the same picture twice: noise comes in turns."""
BLACK, WHITE = 3, 300
MAC_ADDRESS = 0x0A
BITS_8 = 8
"""Bits per pixel stand in bits 16 to 23 of a pixel format. Source: GigE Vision, PFNC."""

C = """
void *arv_gv_fake_camera_new_full(const char *, const char *, const char *);
int arv_gv_fake_camera_is_running(void *);
void *arv_gv_fake_camera_get_fake_camera(void *);
typedef void (*pattern)(void *, void *, uint32_t, uint32_t, uint32_t);
void arv_fake_camera_set_fill_pattern(void *, pattern, void *);
void arv_fake_camera_set_trigger_frequency(void *, double);
int arv_fake_camera_read_register(void *, uint32_t, uint32_t *);
int arv_fake_camera_write_register(void *, uint32_t, uint32_t);
int arv_fake_camera_write_memory(void *, uint32_t, uint32_t, const void *);
void *arv_buffer_get_data(void *, size_t *);
uint64_t arv_buffer_get_timestamp(void *);
void arv_buffer_set_timestamp(void *, uint64_t);
"""
GOBJECT = """
void g_object_set(void *, const char *, ...);
void g_object_unref(void *);
"""


class Scene:
    """What the camera sees, and what befalls it.

    Attributes:
        mood: "normal", "black" or "white".
        frozen: the same bytes are shown again.
    """

    def __init__(self, pictures: list[np.ndarray]) -> None:
        """Takes the pictures that are shown in turn, each (h, w) uint8."""
        self.mood = "normal"
        self.frozen = False
        self._pictures = pictures
        self._shown = 0
        self._last: np.ndarray | None = None
        # Drawn before anybody waits for a picture, and again for another size only.
        self._noises = _noises(pictures[0].shape)

    def next(self, where: tuple[int, int, int, int], brightness: float) -> np.ndarray:
        """Gives the next picture of a region: x, y, width and height [px], uint8."""
        x, y, width, height = where
        if self.frozen and self._last is not None and self._last.shape == (height, width):
            return self._last
        picture = self._pictures[self._shown % len(self._pictures)]
        if self.mood == "normal":
            levels = np.clip(np.arange(256) * brightness, 0, WHITE).astype(np.float32)
            part = levels[picture[y : y + height, x : x + width]]
            below, right = height - part.shape[0], width - part.shape[1]
            part = cv2.copyMakeBorder(part, 0, below, 0, right, cv2.BORDER_CONSTANT)
        else:
            level = BLACK if self.mood == "black" else WHITE
            part = np.full((height, width), level, np.float32)
        noise = self._noise((height, width))
        self._last = cv2.add(part, noise, dtype=cv2.CV_8U)
        self._shown += 1
        return self._last

    def _noise(self, shape: tuple[int, int]) -> np.ndarray:
        if self._noises[0].shape != shape:
            self._noises = _noises(shape)
        return self._noises[self._shown % NOISES]


def _noises(shape: tuple[int, ...]) -> list[np.ndarray]:
    """Draws `NOISES` pictures of noise, (h, w) float32 each."""
    drawn = np.random.default_rng(0).normal(0.0, 1.0, (NOISES, *shape))
    return list(np.rint(drawn).astype(np.float32))


class SceneCamera:
    """The camera on the network."""

    def __init__(self, interface: str, serial: str, phase_ms: float, scene: Scene) -> None:
        """Begins to serve.

        Args:
            interface: Name or IPv4 address.
            serial: What it calls itself.
            phase_ms: So long after the beat of the clock it exposes while it runs freely:
                without it all cameras on one host would expose together.
            scene: What it shows.
        """
        self._ffi = ffi = cffi.FFI()
        ffi.cdef(C)
        ffi.cdef(GOBJECT)
        self._aravis: Any = ffi.dlopen("libaravis-0.8.so.0")
        self._gobject: Any = ffi.dlopen("libgobject-2.0.so.0")
        self._scene, self._phase_ms, self._jumped_ns = scene, phase_ms, 0
        names = interface.encode(), serial.encode()
        self._server = self._aravis.arv_gv_fake_camera_new_full(*names, ffi.NULL)
        if not self._aravis.arv_gv_fake_camera_is_running(self._server):
            raise SystemExit(f"no camera on {interface}: is it there, and the address free?")
        self._camera = self._aravis.arv_gv_fake_camera_get_fake_camera(self._server)
        self._aravis.arv_fake_camera_set_trigger_frequency(self._camera, TICKS_HZ)
        self._pattern = ffi.callback("pattern", self._fill)
        self._aravis.arv_fake_camera_set_fill_pattern(self._camera, self._pattern, ffi.NULL)
        self._name_interface(interface)

    def set_size(self, width_px: int, height_px: int, sensor: bool) -> None:
        """Sets the size that it starts with, and whether its sensor has no more."""
        self._set("width", width_px)
        self._set("height", height_px)
        if sensor:
            self._set("sensor_width", width_px)
            self._set("sensor_height", height_px)

    def obey(self, line: str) -> str:
        """Does what a line says; gives the answer."""
        word, *values = line.split()
        if word in ("freeze", "thaw"):
            self._scene.frozen = word == "freeze"
        elif word in ("black", "white", "normal"):
            self._scene.mood = word
        elif word == "lose":
            self._lose(float(values[0]) / 1000.0)
        elif word == "slow":
            self._set("period_us", round(1e6 / float(values[0])))
        elif word == "jump":
            self._jumped_ns += round(1e6 * float(values[0]))
        else:
            return f"unknown: {line}"
        return "ok"

    def close(self) -> None:
        """Leaves the network."""
        self._gobject.g_object_unref(self._server)

    def _fill(self, buffer: Any, data: Any, exposure_us: int, gain: int, format: int) -> None:
        """Draws one frame; Aravis calls this from its thread."""
        if self._phase_ms and not self._get("trigger_mode"):
            time.sleep(self._phase_ms / 1e3)
            self._aravis.arv_buffer_set_timestamp(buffer, time.time_ns() // 1000 * 1000)
        if self._jumped_ns:
            stamp_ns = self._aravis.arv_buffer_get_timestamp(buffer) + self._jumped_ns
            self._aravis.arv_buffer_set_timestamp(buffer, stamp_ns)
        # Aravis has made sure that the memory holds a picture of this size.
        memory = self._aravis.arv_buffer_get_data(buffer, self._ffi.NULL)
        names = ("offset_x", "offset_y", "width", "height")
        x, y, width, height = (self._get(name) for name in names)
        if (format >> 16) & 0xFF != BITS_8:
            return
        brightness = exposure_us / AS_IT_IS_US * DECIBEL**gain
        picture = self._scene.next((x, y, width, height), brightness)
        self._ffi.memmove(memory, np.ascontiguousarray(picture), width * height)

    def _name_interface(self, interface: str) -> None:
        """Has it say its interface's hardware address, which the simulator leaves empty."""
        path = Path("/sys/class/net") / interface / "address"
        if path.exists():
            mac = bytes.fromhex(path.read_text().strip().replace(":", ""))
            self._aravis.arv_fake_camera_write_memory(self._camera, MAC_ADDRESS, len(mac), mac)

    def _lose(self, share: float) -> None:
        value = self._ffi.cast("double", share)
        self._gobject.g_object_set(self._server, b"gvsp-lost-ratio", value, self._ffi.NULL)

    def _get(self, name: str) -> int:
        value = self._ffi.new("uint32_t *")
        self._aravis.arv_fake_camera_read_register(self._camera, REGISTERS[name], value)
        return int(value[0])

    def _set(self, name: str, value: int) -> None:
        self._aravis.arv_fake_camera_write_register(self._camera, REGISTERS[name], value)


def load(path: Path) -> list[np.ndarray]:
    """Reads a picture, or those of a folder in the order of their names; each (h, w) uint8."""
    if path.is_dir():
        return [load(each)[0] for each in sorted(path.iterdir())]
    if path.suffix == ".npy":
        return [np.load(path)]
    picture = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if picture is None:
        raise SystemExit(f"{path}: no picture")
    return [picture]


def main() -> None:
    """Serves until its input ends or says so."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("interface")
    parser.add_argument("picture", type=Path)
    parser.add_argument("--serial", default="S1")
    parser.add_argument("--size", help="WIDTHxHEIGHT that it starts with; else the picture's")
    parser.add_argument("--sensor", action="store_true", help="no more pixels than that")
    parser.add_argument("--phase-ms", type=float, default=0.0)
    words = parser.parse_args()
    pictures = load(words.picture)
    height_px, width_px = pictures[0].shape
    if words.size:
        width_px, height_px = map(int, words.size.split("x"))
    camera = SceneCamera(words.interface, words.serial, words.phase_ms, Scene(pictures))
    camera.set_size(width_px, height_px, words.sensor)
    print("ready", flush=True)
    for line in sys.stdin:
        if line.strip() == "quit":
            break
        print(camera.obey(line), flush=True)
    camera.close()


if __name__ == "__main__":
    main()
