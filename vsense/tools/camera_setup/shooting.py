"""`vsense camera shoot`: pictures of a board with all cameras at once, for vsense camera calibrate.

Moments are named floor_01, floor_02 and so on; no name is used twice.
"""

from __future__ import annotations

import json
import queue
import re
import sys
import threading
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from vsense.base.arena import Frame, Image
from vsense.base.clock import host_ns
from vsense.base.errors import GrabberError, UsageError, VsenseError, failing_as
from vsense.base.interruption import interruption
from vsense.base.terminal import Console, counted, print_data
from vsense.config import resources as resources_file
from vsense.tools.camera_setup.showing import save_picture
from vsense.vision.calibration.board import Board, CornerFinder
from vsense.vision.cameras.grabber import Grabber, Troubles
from vsense.vision.tracking.opening import live_grabber
from vsense.vision.tracking.single_camera import Size, free, make, session_of
from vsense.vision.tracking.specs import GrabberSpec

FLOOR_MOMENT = "floor"
_PLAIN = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_-]{0,60}")
_NUMBERED = re.compile(r"(.*)_([0-9]{1,6})")


def is_plain(text: str) -> bool:
    """Whether a text is a word that can be a file name on any system."""
    return _PLAIN.fullmatch(text) is not None


class Names:
    """Names of moments; `next` is the default name of the next one."""

    def __init__(self, directory: Path, series: str = FLOOR_MOMENT) -> None:
        """Goes on after the pictures that are in the cameras' folders already."""
        self._taken = {path.stem for path in directory.glob("*/*")}
        self.next = self._first_free(series)

    def choose(self, text: str) -> str:
        """Returns the name for a typed line: empty, a series such as "tilt", or a whole name.

        It is "" where the line is no name, or a name that is taken.
        """
        words = text.strip()
        if not words:
            name = self.next
        elif not is_plain(words):
            return ""
        else:
            name = words if _NUMBERED.fullmatch(words) else self._first_free(words)
        return "" if name in self._taken else name

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
"""Time that a moment waits for a camera."""
FIRST_NS = 6_000_000_000
"""Time for opening the cameras one after the other, and for their first pictures."""
SHOOT_TIMEOUT_S = 0.2


@dataclass(frozen=True, slots=True)
class ShootOptions:
    """Which pictures are taken; see `vsense camera shoot -h`.

    Attributes:
        board: Looked for in the pictures, as `Board.parse` reads it; None: nothing.
        every: Time from one moment to the next [s]; None: the Enter key takes each.
        count: Number of moments; None: no limit.
        name: Of the first series.
        json: The moments are printed for programs.
    """

    resources: str
    output: Path
    board: str | None
    every: float | None
    count: int | None
    name: str
    json: bool = False


def run(options: ShootOptions) -> int:
    """Takes pictures until its input ends, all are taken, or it is interrupted.

    Returns:
        0, 130 after Ctrl-C, or 1 where nothing was taken.

    Raises:
        UsageError: Options contradict each other, or the series' name is no plain word.
        VsenseError: There is no camera, none opens, or a picture cannot be written.
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
        grabber = live_grabber(session.resources, session.grabbers, sizes_px, host_ns)
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
        _end(shoot, options, console)
        if interrupted.is_set():
            return interrupted.code
        return 0 if shoot.moments else 1


def _check(options: ShootOptions) -> None:
    """Refuses options without effect, and names that would write elsewhere."""
    if options.count is not None and options.every is None:
        raise UsageError("--count: expected --every, too: with Enter you end it yourself")
    if not is_plain(options.name):
        raise UsageError(f"--name: {options.name!r} is no plain word of letters, digits, - and _")


class ShootingSession:
    """Pictures of moments, in a folder per camera.

    Attributes:
        moments: Moment -> camera -> number of corners of the board that were found, or None where
            no board was looked for; cameras without a picture are missing.
    """

    def __init__(
        self,
        cameras: list[str],
        directory: Path,
        board: Board | None,
        grabber: Grabber,
        console: Console,
        clock: Callable[[], int] = host_ns,
    ) -> None:
        """Prepares to take pictures of all `cameras` into folders of `directory`.

        `board` is looked for in the pictures; `clock` is the host's monotonic clock [ns].
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
        """Takes the newest pictures, so that none grows old; prints events."""
        try:
            frames = list(self._grabber.next(SHOOT_TIMEOUT_S))
        except GrabberError:
            frames = []
        for line in self._troubles.lines(self._grabber.events()):
            self._console.say(f"vsense: {line}")
        return frames

    def begin(self, interrupted: threading.Event) -> None:
        """Waits until all cameras give pictures, for `FIRST_NS` at most."""
        begun_ns, seen = self._clock(), set[str]()
        while len(seen) < len(self._cameras) and self._clock() - begun_ns < FIRST_NS:
            if interrupted.is_set():
                return
            seen |= {frame.camera for frame in self.idle()}
        missing = [camera for camera in self._cameras if camera not in seen]
        if missing:
            self._console.say(f"vsense: no picture yet of {', '.join(missing)}; going on without")

    def take(self, moment: str) -> bool:
        """Saves a picture of each camera; returns whether any delivered. Raises VsenseError."""
        asked_ns = self._clock()
        images: dict[str, Image] = {}
        while len(images) < len(self._cameras) and self._clock() - asked_ns < WAIT_NS:
            for frame in self.idle():
                # Earlier pictures may show the board while it was moved.
                if frame.capture_ns >= asked_ns:
                    images.setdefault(frame.camera, frame.image.copy())
        counts: dict[str, int | None] = {}
        for camera in filter(images.__contains__, self._cameras):
            folder = self._directory / camera
            with failing_as(VsenseError, f"{folder}: cannot be made"):
                folder.mkdir(parents=True, exist_ok=True)
            save_picture(images[camera], folder / f"{moment}.png")
            counts[camera] = None if self._finder is None else self._corners(images[camera])
        if images:
            self.moments[moment] = counts
        self._console.say(f"{moment}: {', '.join(self._said(c, counts) for c in self._cameras)}")
        return bool(images)

    def _corners(self, image: Image) -> int:
        assert self._finder is not None
        seen = self._finder.find(image)
        return 0 if seen is None else len(seen[0])

    def _said(self, camera: str, counts: dict[str, int | None]) -> str:
        if camera not in counts:
            return f"{camera} NO PICTURE"
        corners = counts[camera]
        if corners is None or self._board is None:
            return f"{camera} taken"
        if corners == 0:
            return f"{camera} no board"
        return f"{camera} {corners} of {len(self._board.points_m)} corners"


def _sizes(specs: list[GrabberSpec], console: Console) -> dict[str, Size]:
    """Reads the sizes of pictures where the file does not say; prints what does not open."""
    sizes_px: dict[str, Size] = {}
    for spec in specs:
        if spec.controls.size_px is not None:
            sizes_px[spec.id] = spec.controls.size_px
            continue
        console.progress(f"opening {spec.id} ...")
        camera = make(free(spec), host_ns)
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
    """Takes a moment with every typed line, until there are no more."""
    lines = _typed()
    console.say("Enter takes a picture; 'tilt' or another word begins a new series; 'q' ends")
    asked = ""
    while not interrupted.is_set():
        if names.next != asked:
            # Only once, because the user's typing follows on the same line.
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
    due_ns, taken = host_ns(), 0
    while not interrupted.is_set() and taken != count:
        due_ns += round(1e9 * every_s)
        while host_ns() < due_ns and not interrupted.is_set():
            shoot.idle()
        if not interrupted.is_set():
            taken += 1
            if shoot.take(names.next):
                names.take(names.next)


def _typed() -> queue.Queue[str | None]:
    """Returns the typed lines as they come, and None after the last."""
    lines: queue.Queue[str | None] = queue.Queue()

    def read() -> None:
        for line in sys.stdin:
            lines.put(line)
        lines.put(None)

    threading.Thread(target=read, name="shoot input", daemon=True).start()
    return lines


def _end(shoot: ShootingSession, options: ShootOptions, console: Console) -> None:
    console.end_progress()
    if options.json:
        print_data(json.dumps(shoot.moments, indent=2))
    if not shoot.moments:
        console.say("vsense: no picture was taken")
        return
    floor = " --floor 'floor_*'" if any(n.startswith(FLOOR_MOMENT) for n in shoot.moments) else ""
    moments = counted(len(shoot.moments), "moment")
    console.say(f"{moments} in {options.output}. What comes next:")
    board = options.board or "BOARD"
    console.say(
        f"  vsense camera calibrate rig --board {board} --pictures {options.output}{floor}"
        " -o cameras"
    )
