"""A GigE Vision or USB3 Vision camera, through Aravis."""

from __future__ import annotations

import threading
from collections.abc import Callable

from vsense.tracking.aravis import AravisError
from vsense.tracking.aravis_camera import AravisCamera, is_address, locate
from vsense.tracking.aravis_stream import AravisStream
from vsense.tracking.genicam_settings import FREE, GenicamSettings, apply
from vsense.tracking.grabbers import GrabberError
from vsense.tracking.gvcp import HELD, controlled
from vsense.tracking.links import Links, Stream
from vsense.tracking.source import FIRST_S, Shot, silence_s

FORGOTTEN_NS = 3_500_000_000
"""A program that died is forgotten after its heartbeat's time, usually 3 s."""
MOST_AGE_NS = 1_000_000_000
"""No picture is older when it is read; the host's wall clock, by which it was noted, may jump."""


class GenicamSource:
    """A camera behind Aravis; belongs to one thread, except for `trigger`."""

    def __init__(
        self,
        device: str,
        settings: GenicamSettings,
        clock: Callable[[], int],
        links: Links | None = None,
    ) -> None:
        """Notes what to open.

        Args:
            device: IPv4 address, id, serial number or MAC address.
            settings: What it is asked for.
            clock: The host's monotonic clock [ns].
            links: Who else is on the network.
        """
        self._device = device
        self._settings = settings
        self._clock = clock
        self._links = links or Links()
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
        """Opens the camera; see `vsense.tracking.source.Source.open`.

        One that was silent and still obeys is not set anew: then the network was gone, not the
        camera.
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
                raise AravisError(HELD)
            camera.stop()
            told = apply(camera, self._settings)
            if camera.is_gige:
                self._claim(camera, name)
            self._stream = AravisStream(camera)
        except BaseException:
            camera.close()
            raise
        self._camera, self._resumed, self._running = camera, False, False
        return told

    def read(self) -> Shot:
        """Waits for the next picture.

        Raises:
            PictureError: It is damaged; the next one may be good.
            GrabberError: None comes.
        """
        if self._stream is None:
            raise GrabberError(f"{self._device} is not open")
        patience_s = self._patience_s if self._running else max(FIRST_S, self._patience_s)
        got = self._stream.read(patience_s)
        if got is None:
            raise GrabberError(f"gives no pictures for {patience_s:g} s")
        self._running, self._resumed = True, False
        image, stamp_ns, age_ns = got
        known = 0 <= age_ns < MOST_AGE_NS
        # A camera without a clock of its own stamps everything with 0.
        return Shot(image, stamp_ns or None, self._clock() - age_ns if known else None)

    def trigger(self) -> None:
        """Has a picture taken now; from any thread. A camera that is not open takes none.

        Raises:
            AravisError: It does not answer, or refuses.
        """
        camera = self._camera
        if camera is not None:
            camera.trigger()

    def close(self) -> None:
        """Lets it go; can be called again."""
        stream, self._stream = self._stream, None
        camera, self._camera = self._camera, None
        if camera is None or camera.answers:
            _let_go(stream, camera)
        else:
            # Aravis says goodbye for many seconds to a camera that does not answer.
            threading.Thread(target=_let_go, args=(stream, camera), daemon=True).start()

    def _obeys(self) -> bool:
        """Whether the camera is open and under control, and may only have been cut off."""
        return self._camera is not None and not self._resumed and self._camera.in_control

    def _check_control(self, name: str) -> None:
        """Refuses a camera that is somebody else's.

        Some do not even answer who asks for control, and Aravis would ask for seconds; some take
        the question who has it for a sign of life of who had it, and so it is not asked too often.
        """
        now_ns = self._clock()
        if is_address(name) and now_ns >= self._held_until_ns and controlled(name):
            self._held_until_ns = now_ns + FORGOTTEN_NS
        if now_ns < self._held_until_ns:
            raise AravisError(HELD)

    def _claim(self, camera: AravisCamera, address: str) -> None:
        """Refuses to send more than the network carries."""
        size_px = int(camera.get("Width")), int(camera.get("Height"))
        rate_hz = self._settings.controls.rate_hz
        if rate_hz is None or self._settings.trigger == FREE:
            # What it kept, which may not be what it was asked for.
            rate_hz = camera.rate_hz
        stream = Stream(size_px, rate_hz, camera.packet_size)
        self._links.claim(self._device, address, stream)


def _let_go(stream: AravisStream | None, camera: AravisCamera | None) -> None:
    """Ends a camera's stream, and gives control back."""
    try:
        if stream is not None:
            stream.close()
    except AravisError:
        # It is gone already: there is nobody to stop.
        pass
    finally:
        if camera is not None:
            camera.close()
