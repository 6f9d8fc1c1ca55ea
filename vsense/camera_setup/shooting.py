"""`vsense cameras shoot`: pictures of a board with all cameras at once, for vsense calibrate.

Moments are named floor_01, floor_02 and so on; no name is used twice.
"""

from __future__ import annotations

import json
import queue
import re
import sys
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from vsense.arena import Frame
from vsense.calibration.board import Board
from vsense.calibration.views import CornerFinder
from vsense.camera_setup.opening import Size, free, make, session_of, sizes_of
from vsense.camera_setup.showing import save_picture
from vsense.cameras.genicam import GenicamSettings
from vsense.cameras.grabber import Grabber, GrabberError, Troubles
from vsense.cameras.picture import Image
from vsense.config import resources as resources_file
from vsense.errors import UsageError, VsenseError
from vsense.terminal import INTERRUPTED, Console, interruption
from vsense.tracking.opening import live_grabber
from vsense.tracking.specs import GrabberSpec

FLOOR = "floor"
_PLAIN = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_-]{0,60}")
_NUMBERED = re.compile(r"(.*)_([0-9]{1,6})")


def is_plain(text: str) -> bool:
    """Whether a text is a word that can be a file's name everywhere."""
    return _PLAIN.fullmatch(text) is not None


class Names:
    """Gives each moment its name.

    Attributes:
        next: what the next moment is called if nobody says otherwise.
    """

    def __init__(self, directory: Path, series: str = FLOOR) -> None:
        """Goes on after the pictures that are in the cameras' folders already."""
        self._taken = {path.stem for path in directory.glob("*/*")}
        self.next = self._first_free(series)

    def choose(self, text: str) -> str:
        """Takes what a person has typed: nothing, a series such as "tilt", or a whole name.

        Returns:
            The moment's name, or "" where the text is none, or taken.
        """
        words = text.strip()
        if not words:
            name = self.next
        elif not is_plain(words):
            return ""
        else:
            name = words if _NUMBERED.fullmatch(words) else self._first_free(words)
        if name in self._taken:
            return ""
        return name

    def take(self, name: str) -> None:
        """Notes that a name is used; its series goes on with the next number."""
        self._taken.add(name)
        numbered = _NUMBERED.fullmatch(name)
        assert numbered is not None
        self.next = self._first_free(numbered[1], int(numbered[2]) + 1)

    def _first_free(self, series: str, number: int = 1) -> str:
        while f"{series}_{number:02d}" in self._taken:
            number += 1
        return f"{series}_{number:02d}"


WAIT_NS = 1_500_000_000
"""A camera that has no picture for this long after the others' is left out of a moment."""
FIRST_NS = 6_000_000_000
"""Cameras open one after the other, and some need a while for their first picture."""
SILENCE_S = 0.2


@dataclass(frozen=True, slots=True)
class ShootOptions:
    """Which pictures are taken.

    Attributes:
        resources: path of the resources file: all its cameras take part.
        output: gets a folder per camera.
        board: what to look for in the pictures, as `Board.parse` reads it, None: nothing.
        every: time from one moment to the next [s]; None: the Enter key takes each.
        count: ends after so many moments, None: does not end by itself.
        name: of the first series.
    """

    resources: str
    output: Path
    board: str | None
    every: float | None
    count: int | None
    name: str


def run(options: ShootOptions, as_json: bool) -> int:
    """Takes pictures until its input ends, all are taken, or it is interrupted.

    With `as_json` the moments are printed for programs.

    Returns:
        0, 130 after Ctrl-C, or 1 where nothing was taken.

    Raises:
        UsageError: options contradict each other, or the series' name is no plain word.
        VsenseError: there is no camera, none opens, or a picture cannot be written.
    """
    _check(options)
    board = Board.parse(options.board) if options.board else None
    resources = resources_file.load(options.resources)
    specs = [spec for spec in resources.grabbers.values() if spec.is_live]
    if not specs:
        raise UsageError(f"{options.resources}: has no grabber that is a camera")
    with ExitStack() as stack:
        interrupted = stack.enter_context(interruption())
        console = Console()
        sizes_px = _sizes(specs, console)
        session = session_of(options.resources, [s for s in specs if s.id in sizes_px], sizes_px)
        grabber = live_grabber(session, sizes_of(session), time.monotonic_ns)
        stack.callback(grabber.close)
        shoot = ShootingSession(
            [spec.id for spec in specs], options.output, board, grabber, console
        )
        shoot.begin(interrupted)
        names = Names(options.output, options.name)
        if options.every is None:
            _by_hand(shoot, names, interrupted, console)
        else:
            _by_itself(shoot, names, options.every, options.count, interrupted)
        _end(shoot, options, as_json, console)
        if interrupted.is_set():
            return INTERRUPTED
        return 0 if shoot.moments else 1


def _check(options: ShootOptions) -> None:
    """Refuses options that say nothing, or would write elsewhere."""
    if options.count is not None and options.every is None:
        raise UsageError("--count: expected --every, too: with Enter you end it yourself")
    if not is_plain(options.name):
        raise UsageError(f"--name: {options.name!r} is no plain word of letters, digits, - and _")


class ShootingSession:
    """Pictures of moments, in a folder per camera.

    Attributes:
        moments: what was taken: moment -> camera -> how many corners of the board were found, or
            None where no board was looked for; a camera without a picture is missing.
    """

    def __init__(
        self,
        cameras: list[str],
        directory: Path,
        board: Board | None,
        grabber: Grabber,
        console: Console,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        """Prepares to take pictures.

        Args:
            cameras: ids of all cameras.
            directory: gets a folder per camera.
            board: what to look for in the pictures.
            grabber: of these cameras.
            console: what a person is told.
            clock: host's monotonic clock [ns].
        """
        self._cameras = cameras
        self._directory = directory
        self._board = board
        self._finder = None if board is None else CornerFinder(board)
        self._grabber = grabber
        self._console = console
        self._clock = clock
        self._troubles = Troubles()
        self.moments: dict[str, dict[str, int | None]] = {}

    def idle(self) -> list[Frame]:
        """Takes the newest pictures, so that none waits and grows old; tells what happens."""
        try:
            frames = list(self._grabber.next(SILENCE_S))
        except GrabberError:
            frames = []
        for line in self._troubles.lines(self._grabber.events()):
            self._console.say(f"vsense: {line}")
        return frames

    def begin(self, interrupted: threading.Event) -> None:
        """Waits until all cameras give pictures, but not for ever."""
        begun_ns, seen = self._clock(), set[str]()
        while len(seen) < len(self._cameras) and self._clock() - begun_ns < FIRST_NS:
            if interrupted.is_set():
                return
            seen |= {frame.camera for frame in self.idle()}
        missing = [camera for camera in self._cameras if camera not in seen]
        if missing:
            self._console.say(f"vsense: no picture yet of {', '.join(missing)}; going on without")

    def take(self, moment: str) -> bool:
        """Takes a picture with every camera that delivers, and says what is in them.

        Returns:
            Whether one delivered.

        Raises:
            VsenseError: a picture cannot be written.
        """
        asked_ns = self._clock()
        images: dict[str, Image] = {}
        while len(images) < len(self._cameras) and self._clock() - asked_ns < WAIT_NS:
            for frame in self.idle():
                # Taken after it was asked for: whoever held the board holds it still now.
                if frame.capture_ns >= asked_ns:
                    images.setdefault(frame.camera, frame.image.copy())
        found: dict[str, int | None] = {}
        for camera in filter(images.__contains__, self._cameras):
            folder = self._directory / camera
            try:
                folder.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise VsenseError(f"{folder}: cannot be made: {error.strerror}") from None
            save_picture(images[camera], folder / f"{moment}.png")
            found[camera] = None if self._finder is None else self._corners(images[camera])
        if images:
            self.moments[moment] = found
        self._console.say(f"{moment}: {', '.join(self._said(c, found) for c in self._cameras)}")
        return bool(images)

    def _corners(self, image: Image) -> int:
        assert self._finder is not None
        seen = self._finder.find(image)
        return 0 if seen is None else len(seen[0])

    def _said(self, camera: str, found: dict[str, int | None]) -> str:
        if camera not in found:
            return f"{camera} NO PICTURE"
        corners = found[camera]
        if corners is None or self._board is None:
            return f"{camera} taken"
        if corners == 0:
            return f"{camera} no board"
        return f"{camera} {corners} of {len(self._board.points_m)} corners"


def _sizes(specs: list[GrabberSpec], console: Console) -> dict[str, Size]:
    """Looks how large pictures are where the file does not say; tells of what does not open."""
    sizes_px: dict[str, Size] = {}
    for spec in specs:
        settings = spec.settings
        controls = settings.controls if isinstance(settings, GenicamSettings) else settings
        if controls is not None and controls.size_px is not None:
            sizes_px[spec.id] = controls.size_px
            continue
        console.progress(f"opening {spec.id} ...")
        camera = make(free(spec))
        try:
            camera.open()
            height, width = camera.picture().image.shape
            sizes_px[spec.id] = (width, height)
        except GrabberError as error:
            console.say(f"vsense: {error}")
        finally:
            camera.source.close()
    console.end_progress()
    if not sizes_px:
        raise VsenseError("no camera gives pictures")
    return sizes_px


def _by_hand(
    shoot: ShootingSession, names: Names, interrupted: threading.Event, console: Console
) -> None:
    """Takes a moment with every line that is typed, until there are no more."""
    lines = _typed()
    console.say("Enter takes a picture; 'tilt' or another word begins a new series; 'q' ends")
    asked = ""
    while not interrupted.is_set():
        if names.next != asked:
            # Once and not always: what is being typed stands behind it.
            asked = names.next
            console.progress(f"{asked}? ")
        shoot.idle()
        try:
            line = lines.get_nowait()
        except queue.Empty:
            continue
        if line is None or line.strip() == "q":
            return
        name = names.choose(line)
        if not name:
            console.say(f"{line.strip()!r} is no plain name, or there are pictures of that name")
        elif shoot.take(name):
            names.take(name)


def _by_itself(
    shoot: ShootingSession,
    names: Names,
    every_s: float,
    count: int | None,
    interrupted: threading.Event,
) -> None:
    """Takes a moment every so many seconds."""
    due_ns, taken = time.monotonic_ns(), 0
    while not interrupted.is_set() and taken != count:
        due_ns += round(1e9 * every_s)
        while time.monotonic_ns() < due_ns and not interrupted.is_set():
            shoot.idle()
        if not interrupted.is_set():
            taken += 1
            if shoot.take(names.next):
                names.take(names.next)


def _typed() -> queue.Queue[str | None]:
    """Gives the lines that are typed as they come, and None after the last."""
    lines: queue.Queue[str | None] = queue.Queue()

    def read() -> None:
        for line in sys.stdin:
            lines.put(line)
        lines.put(None)

    threading.Thread(target=read, name="shoot input", daemon=True).start()
    return lines


def _end(shoot: ShootingSession, options: ShootOptions, as_json: bool, console: Console) -> None:
    """Says what was taken, and what comes next."""
    console.end_progress()
    if as_json:
        print(json.dumps(shoot.moments, indent=2))
    if not shoot.moments:
        console.say("vsense: no picture was taken")
        return
    floor = " --floor 'floor_*'" if any(n.startswith(FLOOR) for n in shoot.moments) else ""
    count = len(shoot.moments)
    moments = f"{count} moment{'' if count == 1 else 's'}"
    console.say(f"{moments} in {options.output}. What comes next:")
    board = options.board or "BOARD"
    console.say(
        f"  vsense calibrate rig --board {board} --pictures {options.output}{floor} -o cameras"
    )
