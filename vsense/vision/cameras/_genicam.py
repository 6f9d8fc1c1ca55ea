"""A GigE Vision or USB3 Vision camera through Aravis; every setting is read back."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence

from vsense.base.errors import GrabberError
from vsense.vision.cameras._aravis_camera import AravisCamera, AravisStream, is_address, locate
from vsense.vision.cameras._networks import CAMERA_HELD, NetworkLoad, Stream, controlled
from vsense.vision.cameras.aravis import AravisError
from vsense.vision.cameras.source import (
    AUTOMATIC,
    FIRST_S,
    FREE,
    NAMES,
    PIXEL_FORMATS,
    SOFTWARE,
    Bounds,
    GenicamSettings,
    Shot,
    Value,
    absent,
    refused,
    said,
    silence_s,
)


def apply(camera: AravisCamera, settings: GenicamSettings) -> list[str]:
    """Sets everything; returns what was refused or rounded. Raises AravisError if unusable."""
    return _Setting(camera, settings).all()


class _Setting:
    def __init__(self, camera: AravisCamera, settings: GenicamSettings) -> None:
        self._camera = camera
        self._settings = settings
        self._said: list[str] = []

    def all(self) -> list[str]:
        """Sets everything; returns what the camera refused or rounded."""
        camera, settings, controls = self._camera, self._settings, self._settings.controls
        wanted = {"exposure_time_abs": controls.exposure_us, "gain_raw": controls.gain_raw}
        light = {name: value for name, value in wanted.items() if value is not None}
        for automatic in (AUTOMATIC[name] for name in light):
            if camera.has(automatic):
                self._feature(automatic, automatic, "Off")
        self._pixels()
        self._times()
        for name, value in light.items():
            self._control(name, value)
        for feature, text in settings.features:
            self._control(feature, text, (feature,))
        if camera.is_gige:
            self._packets()
        return self._said

    def _pixels(self) -> None:
        """Sets the format and the part of the sensor that is read."""
        camera = self._camera
        formats = camera.formats()
        usable = [name for name in PIXEL_FORMATS if name in formats]
        if not usable:
            has, expected = ", ".join(formats), ", ".join(PIXEL_FORMATS)
            raise AravisError(f"has the pixel formats {has}; expected one of {expected}")
        self._control("pixel_format", self._settings.pixel_format or usable[0])
        if camera.get("PixelFormat") not in PIXEL_FORMATS:
            self._control("pixel_format", usable[0])
        size_px, offset_px = self._settings.controls.size_px, self._settings.offset_px
        if size_px is not None:
            # An offset limits the size, so offsets are set to 0 first.
            for name in ("OffsetX", "OffsetY"):
                if camera.has(name):
                    self._feature(name, name, 0)
            self._control("width", size_px[0])
            self._control("height", size_px[1])
        if offset_px is not None:
            self._control("offset_x", offset_px[0])
            self._control("offset_y", offset_px[1])

    def _times(self) -> None:
        """Sets the trigger, or else the rate, which switches triggers off."""
        camera = self._camera
        trigger, rate_hz = self._settings.trigger, self._settings.controls.rate_hz
        if trigger != FREE:
            source = "Software" if trigger == SOFTWARE else trigger
            camera.set_trigger(source)
            self._note("trigger", source, camera.get("TriggerSource"))
        elif rate_hz is not None:
            try:
                camera.set_rate(rate_hz)
                self._note("frame_rate", rate_hz, camera.rate_hz)
            except AravisError as error:
                self._said.append(f"{refused('frame_rate', rate_hz, None)}: {error}")
        else:
            camera.set_trigger(None)

    def _packets(self) -> None:
        camera = self._camera
        size, delay_us = self._settings.packet_size, self._settings.packet_delay_us
        try:
            camera.set_packets(size, delay_us)
            if size is not None:
                self._note("packet_size", size, camera.packet_size)
            if delay_us is not None:
                self._note("packet_delay", delay_us, camera.packet_delay_us)
        except AravisError as error:
            self._said.append(f"does not take packet_size or packet_delay: {error}")

    def _control(self, name: str, value: Value, features: Sequence[str] = ()) -> None:
        """Sets the first of some features that the camera has, by default those of a name."""
        feature = next((f for f in features or NAMES[name] if self._camera.has(f)), None)
        if feature is None:
            self._said.append(absent(name))
        else:
            self._feature(name, feature, value)

    def _feature(self, name: str, feature: str, value: Value) -> None:
        """Sets a feature, reads it back, and notes a difference."""
        camera = self._camera
        bounds = None if isinstance(value, str) else camera.bounds(feature)
        try:
            camera.set(feature, value if isinstance(value, str) else digits(value))
        except AravisError as error:
            beyond = bounds is not None and not bounds[0] <= float(value) <= bounds[1]
            actual = _like(value, camera.get(feature))
            # The camera's own message is shown where bounds do not explain the refusal.
            message = refused(name, value, actual, bounds if beyond else None)
            self._said.append(message if beyond else f"{message} ({error})")
        else:
            self._note(name, value, _like(value, camera.get(feature)), bounds)

    def _note(self, name: str, wanted: Value, got: Value, bounds: Bounds | None = None) -> None:
        text = said(name, wanted, got, bounds)
        if text is not None:
            self._said.append(text)


def digits(value: float) -> str:
    """Writes a number with all its digits, whole ones without a point."""
    return str(int(value)) if float(value).is_integer() else repr(float(value))


def _like(wanted: Value, text: str) -> Value:
    """Reads a camera's text as the type of the wanted value."""
    if isinstance(wanted, str):
        try:
            # Numbers written as text: "8000" and "8000.0" are the same.
            return wanted if float(wanted) == float(text) else text
        except ValueError:
            return text
    try:
        return float(text)
    except ValueError:
        return text


FORGOTTEN_NS = 3_500_000_000
"""A dead program loses control after its heartbeat's time, usually 3 s."""
MOST_AGE_NS = 1_000_000_000
"""Ages beyond this are a jump of the host's wall clock, by which Aravis notes arrivals."""


class GenicamSource:
    """A camera behind Aravis; belongs to one thread, except for `trigger`."""

    def __init__(
        self,
        device: str,
        settings: GenicamSettings,
        clock: Callable[[], int],
        links: NetworkLoad | None = None,
    ) -> None:
        """Notes a device (IPv4 address, id, serial number or MAC address) to open.

        `clock` is the host's monotonic clock [ns]; `links` is shared by all cameras.
        """
        self._device = device
        self._settings = settings
        self._clock = clock
        self._links = links or NetworkLoad()
        self._camera: AravisCamera | None = None
        self._stream: AravisStream | None = None
        self._resumed = False
        self._running = False
        self._held_until_ns = 0
        self._patience_s = silence_s(settings.controls.rate_hz)

    @property
    def camera(self) -> AravisCamera | None:
        """The opened camera, for the thread that reads; None while it is closed."""
        return self._camera

    def open(self) -> list[str]:
        """See `Source.open`.

        A silent camera that is still under control is not set again: only the network was gone.
        """
        if self._obeys():
            self._resumed = True
            return []
        self.close()
        name = locate(self._device)
        self._check_control(name)
        camera = AravisCamera(name)
        try:
            if not camera.in_control:
                raise AravisError(CAMERA_HELD)
            camera.stop()
            messages = apply(camera, self._settings)
            if camera.is_gige:
                self._claim(camera, name)
            self._stream = AravisStream(camera)
        except BaseException:
            camera.close()
            raise
        self._camera, self._resumed, self._running = camera, False, False
        return messages

    def read(self) -> Shot:
        """See `Source.read`."""
        if self._stream is None:
            raise GrabberError(f"{self._device} is not open")
        patience_s = self._patience_s if self._running else max(FIRST_S, self._patience_s)
        got = self._stream.read(patience_s)
        if got is None:
            raise GrabberError(f"gives no pictures for {patience_s:g} s")
        self._running, self._resumed = True, False
        image, stamp_ns, age_ns = got
        has_age = 0 <= age_ns < MOST_AGE_NS
        # A camera without a clock of its own stamps everything with 0.
        return Shot(image, stamp_ns or None, self._clock() - age_ns if has_age else None)

    def trigger(self) -> None:
        """See `Triggered.trigger` of `vsense.vision.cameras._live_grabber`."""
        camera = self._camera
        if camera is not None:
            camera.trigger()

    def close(self) -> None:
        """See `Source.close`."""
        stream, self._stream = self._stream, None
        camera, self._camera = self._camera, None
        if camera is None or camera.answers:
            _let_go(stream, camera)
        else:
            # Aravis takes many seconds to close a camera that does not answer.
            threading.Thread(target=_let_go, args=(stream, camera), daemon=True).start()

    def _obeys(self) -> bool:
        """Whether the camera is open and under control, so that it may only have been cut off."""
        return self._camera is not None and not self._resumed and self._camera.in_control

    def _check_control(self, name: str) -> None:
        """Refuses a camera that another program controls.

        Some such cameras do not answer a request for control, and Aravis would wait for seconds.
        Some take the question for a sign of life of the program that had control, so it is not
        asked too often.
        """
        now_ns = self._clock()
        if is_address(name) and now_ns >= self._held_until_ns and controlled(name):
            self._held_until_ns = now_ns + FORGOTTEN_NS
        if now_ns < self._held_until_ns:
            raise AravisError(CAMERA_HELD)

    def _claim(self, camera: AravisCamera, address: str) -> None:
        """Refuses to send more than the network carries."""
        size_px = int(camera.get("Width")), int(camera.get("Height"))
        rate_hz = self._settings.controls.rate_hz
        if rate_hz is None or self._settings.trigger == FREE:
            # The camera's rate may differ from the one asked for.
            rate_hz = camera.rate_hz
        stream = Stream(size_px, rate_hz, camera.packet_size)
        self._links.claim(self._device, address, stream)


def _let_go(stream: AravisStream | None, camera: AravisCamera | None) -> None:
    try:
        if stream is not None:
            stream.close()
    except AravisError:
        # The camera is gone, so there is nothing to stop.
        pass
    finally:
        if camera is not None:
            camera.close()
