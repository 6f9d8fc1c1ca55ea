"""A node: looks at its cameras' pictures for a tracker on another computer.

Its resources file says which cameras and recordings it has. All else, what to look for and how the
cameras are calibrated, comes from the tracker, so nothing has to be the same in two places. Pixels
stay here, but for coarse previews.
"""

from __future__ import annotations

import json
import queue
import secrets
import threading
from collections import OrderedDict
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

import cv2
import numpy as np

from vsense.base.arena import UNLISTED, Found, Frame, Image
from vsense.base.errors import GrabberError, VsenseError, instead
from vsense.base.files import parse_json
from vsense.vision.cameras._opencv_source import teach_opencv
from vsense.vision.cameras._recorded_grabber import CameraRecording, wrong_size
from vsense.vision.cameras.grabber import CameraEvent, Grabber
from vsense.vision.cameras.health import Health
from vsense.vision.cameras.picture import PictureError
from vsense.vision.tracking._detector import CameraDetectors
from vsense.vision.tracking._node_link import EVENT_KINDS
from vsense.vision.tracking._node_rows import (
    MOST_ROWS,
    MOST_UNLISTED,
    NODE_FORMAT,
    Expectation,
    NodeError,
    SeenPicture,
    SeenRows,
    decode_expectation,
    encode_rows,
)
from vsense.vision.tracking._prediction import Prediction
from vsense.vision.tracking._workers import Picture, Workers
from vsense.vision.tracking.camera_tracking import CHECK_NS
from vsense.vision.tracking.node_session import (
    NodeNetwork,
    answer_by,
    hear,
    is_connected,
    node_key,
    open_network,
    put,
    refuse,
    reply,
    wait_in,
)
from vsense.vision.tracking.opening import live_grabber, open_recording
from vsense.vision.tracking.recorded_tracker import seen_by
from vsense.vision.tracking.specs import Resources

POLL_S, REACH_NS = 0.2, 2_000_000_000
HOLD_NS, IDLE_NS = 2_000_000_000, 30_000_000_000
"""A tracker that was heard so lately keeps its node; one that says nothing for so long is gone."""
PREVIEW_NS, PREVIEW_PX, _QUALITY, _KEPT, _READERS = 1_000_000_000, 405, 60, 8, 2
_UNSERVED = (ArithmeticError, AttributeError, LookupError, TypeError, ValueError, cv2.error)
"""What a setup or a question raises that no tracker has."""


class NodeService:
    """What a node does for one tracker: pictures in, what is in them out.

    Attributes:
        tracker, session: The tracker's numbers; `numbers` are the cameras', by their ids.
        grabber: Of live cameras; None: recordings, whose pictures are asked for.
        heard_ns: When the tracker was heard last.
        newest: The newest expectation, and when it came; None: none.
    """

    def __init__(
        self, setup: dict[str, Any], resources: Resources, clock: Callable[[], int]
    ) -> None:
        """Opens what a tracker asks for; VsenseError: it is not here. No tracker's: `_UNSERVED`."""
        if setup["format"] != NODE_FORMAT:
            formats = f"the tracker's format is {setup['format']}, this is {NODE_FORMAT}"
            raise NodeError(f"{formats}: expected the same vsense on both computers")
        self.tracker, self.session = int(setup["tracker"]), int(setup["session"])
        self._setup = {**setup, "session": 0}
        self.cameras, searches, plan = seen_by(setup["tracking"])
        self.numbers = {camera.id: number for number, camera in enumerate(self.cameras)}
        self.heard_ns = clock()
        self.newest: tuple[Expectation, int] | None = None
        self._tags = {search.family.name: search.family.tags for search in searches}
        self._clock, self._prediction = clock, Prediction(plan)
        self._recordings: list[CameraRecording] = []
        self._images = [OrderedDict[int, Image]() for _ in self.cameras]
        self._reading = [threading.Lock() for _ in self.cameras]
        self._checked_ns = -CHECK_NS
        heights_m = {tag: h for search in searches for tag, h in search.heights_m.items()}
        if (count := len(heights_m)) > MOST_ROWS:
            raise NodeError(f"{count} tags, expected at most {MOST_ROWS}")
        # With more processors there may be more nodes, which would all take the first two.
        self._workers = Workers(2, pin=cv2.getNumberOfCPUs() <= 2)
        self._health = Health(self.cameras, heights_m)
        sees = {c.id: search for c, search in zip(self.cameras, searches, strict=True)}
        self._detector = CameraDetectors(sees, self._prediction, self._workers)
        self.grabber: Grabber | None = None
        self._open(setup, resources)

    def _open(self, setup: dict[str, Any], resources: Resources) -> None:
        """Opens cameras or recordings; raises as `__init__`."""
        live, specs, known = bool(setup["live"]), [], resources.grabbers
        for id in map(str, setup["grabbers"]):
            if id not in known:
                raise VsenseError(f"has no <grabber> {id!r}; {instead(id, known)}")
            if known[id].node or known[id].is_live != live:
                wanted = "camera" if live else "recording"
                raise VsenseError(f"{id!r} has type {known[id].type} here, expected a {wanted}")
            specs.append(known[id])
        if live:
            grabbers = dict(zip(self.numbers, specs, strict=True))
            sizes_px = {c.id: (c.width_px, c.height_px) for c in self.cameras}
            self.grabber = live_grabber(resources, grabbers, sizes_px, self._clock)
        else:
            self._recordings = [open_recording(resources, spec) for spec in specs]

    def goes_on(self, setup: dict[str, Any]) -> bool:
        """Begins another session if it is for the same, after a silence: cameras stay open."""
        if {**setup, "session": 0} != self._setup:
            return False
        self.session, self.newest, self.heard_ns = int(setup["session"]), None, self._clock()
        return True

    def answer(self) -> bytes:
        """What the tracker is told when it has begun."""
        if self.grabber is not None:
            return b"{}"
        taken = [[(t.picture, t.timestep, t.capture_ns) for t in r.taken] for r in self._recordings]
        return json.dumps({"taken": taken}).encode()

    def read(self, number: int, place: int) -> Image:
        """Reads a recording's picture; PictureError where it cannot be used."""
        kept, camera = self._images[number], self.cameras[number]
        with self._reading[number]:
            if place not in kept:
                image = self._recordings[number].read(place)
                if image.shape != (camera.height_px, camera.width_px):
                    raise PictureError(wrong_size(image, (camera.width_px, camera.height_px)))
                kept[place] = image
            kept.move_to_end(place)
            while len(kept) > _KEPT:
                kept.popitem(last=False)
            return kept[place]

    def preview(self, image: Image) -> bytes:
        """Returns a coarse JPEG of a picture (h, w)."""
        scale = PREVIEW_PX / image.shape[1]
        size = PREVIEW_PX, max(round(image.shape[0] * scale), 1)
        small = cv2.resize(image, size, interpolation=cv2.INTER_AREA) if scale < 1.0 else image
        return cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1].tobytes()

    def take(self, expectation: Expectation) -> None:
        """Makes an expectation the newest; NodeError: it is none of this session, or comes late."""
        last = -1 if self.newest is None else self.newest[0].number
        if expectation.session != self.session or expectation.number <= last:
            raise NodeError("an expectation of another session, or one that came before")
        tags, camera = list(self._tags.values()), max(expectation.turns, default=0)
        joined = all(f < len(tags) and 0 <= t < tags[f] for f, t, _ in expectation.joined)
        if camera >= len(self.cameras) or not joined:
            raise NodeError("an expectation of a camera, a family or a tag that is not here")
        self.heard_ns = self._clock()
        self.newest = expectation, self.heard_ns

    def look(self, frames: Sequence[Frame], capture_ns: int) -> list[Found]:
        """Looks for what the newest expectation says; `capture_ns` is by the tracker's clock."""
        prediction = self._prediction
        if self.newest is not None:
            self._learn(self.newest[0])
        prediction.foresee(capture_ns)
        cameras = [self.cameras[self.numbers[frame.camera]] for frame in frames]
        pictures = [Picture(f.image, c) for f, c in zip(frames, cameras, strict=True)]
        detected = self._detector.detect_all(pictures)
        found = []
        for frame, (rows, full) in zip(frames, detected, strict=True):
            there = prediction.unlisted.get(frame.camera)
            pairs = [] if there is None else zip(there.tags.tolist(), there.places.tolist())
            unlisted = np.array([(tag, *place) for tag, place in pairs], dtype=UNLISTED)
            found.append(Found(rows, full, unlisted[:MOST_UNLISTED]))
        return found

    def _learn(self, expectation: Expectation) -> None:
        prediction, tags = self._prediction, expectation.known["tag"].tolist()
        heights_m = dict(zip(tags, expectation.heights_m.tolist(), strict=True))
        for number, (turn, _) in expectation.turns.items():
            prediction.turns[self.cameras[number].id] = turn
        families, joined = list(self._tags), dict.fromkeys(self._tags, tuple[int, ...]())
        for number, tag, _ in expectation.joined:
            joined[families[number]] += (tag,)
        prediction.adopt(
            expectation.known, heights_m, expectation.is_key_frame, expectation.gone, joined
        )

    def troubles(
        self, frames: Sequence[Frame], found: Sequence[Found], all_of_them: bool
    ) -> list[CameraEvent]:
        """What happens to the cameras, as far as pictures show it; checked as a tracker does."""
        events = [] if self.grabber is None else self.grabber.events()
        now_ns = max((frame.capture_ns for frame in frames), default=0)
        if frames and (all_of_them or now_ns - self._checked_ns >= CHECK_NS):
            self._checked_ns = now_ns
            seen = {frame.camera: rows for frame, (rows, *_) in zip(frames, found)}
            events += self._health.update(frames, seen)
        return [event for event in events if event.kind in EVENT_KINDS.split()]

    def close(self) -> None:
        """Closes cameras and recordings."""
        if self.grabber is not None:
            self.grabber.close()
        for recording in self._recordings:
            recording.close()
        self._workers.close()


class CameraNode:
    """A node, which serves one tracker after the other."""

    def __init__(
        self,
        resources: Resources,
        network: NodeNetwork,
        name: str,
        clock: Callable[[], int],
        say: Callable[[str], None],
    ) -> None:
        """Opens the network; UsageError or VsenseError where Zenoh is missing or does not begin.

        `resources` are what it has, `name` is what the tracker calls it, `clock` is the host's
        [ns]; `say` takes a line for a person, from any thread.
        """
        teach_opencv()
        cv2.setNumThreads(1)
        self._resources, self._clock, self._say = resources, clock, say
        self._key = partial(node_key, network.arena, name)
        self._service: NodeService | None = None
        self._queries = queue.Queue[Any](_READERS)
        self._number, self._refused, self._previewed_ns = 0, 0, -PREVIEW_NS
        self._readers = ThreadPoolExecutor(_READERS, "reading")
        self._looking = ThreadPoolExecutor(1, "looking")
        read, look = partial(self._answer, self._read), partial(self._answer, self._look)
        self._zenoh = session = open_network(network)
        self._declared = [
            session.declare_queryable(self._key("open"), partial(wait_in, self._queries)),
            session.declare_queryable(self._key("read"), answer_by(self._readers, read)),
            session.declare_queryable(self._key("detect"), answer_by(self._looking, look)),
            hear(session, self._key("expect"), self._expect),
            hear(session, self._key("leave"), self._leave),
            session.liveliness().declare_token(self._key(f"here/{secrets.token_hex(8)}")),
        ]

    def run(self, ended: threading.Event) -> None:
        """Serves trackers until `ended`."""
        tell_ns: int | None = self._clock() + REACH_NS
        while not ended.is_set():
            service = self._service
            if tell_ns is not None and self._clock() > tell_ns:
                tell_ns = None
                if not is_connected(self._zenoh):
                    self._say("reaches nobody yet: does the tracker run, are certificates valid?")
            if service is not None and self._clock() - service.heard_ns > IDLE_NS:
                self._say("the tracker is gone: waiting for the next one")
                self._drop()
                service = None
            live = service is not None and service.grabber is not None
            try:
                self._open(self._queries.get(timeout=0.0 if live else POLL_S))
            except queue.Empty:
                if live and service is not None:
                    try:
                        self._serve(service)
                    except (VsenseError, *_UNSERVED) as error:
                        self._say(f"cannot look for this tracker: {error}; waiting for the next")
                        self._drop()

    def close(self) -> None:
        """Leaves the network and lets the cameras go."""
        self._zenoh.close()
        self._readers.shutdown(cancel_futures=True)
        self._looking.shutdown(cancel_futures=True)
        self._drop()

    def _open(self, query: Any) -> None:
        """Begins to serve a tracker; refuses while another one is served."""
        present = self._service
        try:
            setup = parse_json(query.payload.to_bytes().decode())
            held = present is not None and self._clock() - present.heard_ns < HOLD_NS
            if held and present is not None and present.tracker != setup["tracker"]:
                raise VsenseError("serves another tracker")
            if present is None or not present.goes_on(setup):
                self._drop()
                present = self._service = NodeService(setup, self._resources, self._clock)
                self._say(f"looks for a tracker: {', '.join(present.numbers)}")
        except VsenseError as error:
            refuse(query, str(error))
            return
        except _UNSERVED as error:
            refuse(query, f"asked for what is no setup of a tracker: {error!r}")
            return
        reply(query, present.answer())

    def _drop(self) -> None:
        service, self._service = self._service, None
        if service is not None:
            service.close()

    def _serve(self, service: NodeService) -> None:
        """Waits for a timestep's pictures, looks at them and says what is there."""
        assert service.grabber is not None
        try:
            frames = service.grabber.next(POLL_S)
        except GrabberError:
            self._tell(service, service.troubles((), (), False))
            return
        offset_ns = 0 if service.newest is None else service.newest[0].offset_ns
        found = service.look(frames, max(frame.capture_ns for frame in frames) - offset_ns)
        self._number += 1
        put(self._zenoh, self._key("rows"), self._rows(service, self._number, frames, found))
        self._tell(service, service.troubles(frames, found, False))
        if self._clock() - self._previewed_ns >= PREVIEW_NS:
            self._previewed_ns = self._clock()
            for frame in frames:
                key = self._key(f"preview/{service.numbers[frame.camera]}")
                put(self._zenoh, key, service.preview(frame.image), urgent=False)

    def _rows(
        self, service: NodeService, number: int, frames: Sequence[Frame], found: Sequence[Found]
    ) -> bytes:
        pictures = [
            SeenPicture(service.numbers[f.camera], f.capture_ns, seen)
            for f, seen in zip(frames, found, strict=True)
        ]
        now_ns, newest = self._clock(), service.newest
        echo = (0, 0) if newest is None else (newest[0].sent_ns, now_ns - newest[1])
        return encode_rows(SeenRows(service.session, number, now_ns, *echo, pictures))

    def _tell(self, service: NodeService, events: Sequence[CameraEvent]) -> None:
        for event in events:
            self._say(str(event))
        if events:
            rows = [[service.numbers[e.camera], e.kind, e.text] for e in events]
            put(self._zenoh, self._key("events"), json.dumps([service.session, rows]).encode())

    def _expect(self, sample: Any) -> None:
        """Takes an expectation; a thread of Zenoh's."""
        try:
            if (service := self._service) is not None:
                service.take(decode_expectation(sample.payload.to_bytes()))
        except NodeError as error:
            self._refused += 1
            if self._refused == 1:  # a stranger must not fill the log
                self._say(f"refused {error}; more of this is not told")

    def _leave(self, sample: Any) -> None:
        """The tracker has ended; a thread of Zenoh's."""
        service = self._service
        if service is not None and sample.payload.to_bytes() == str(service.session).encode():
            service.heard_ns -= IDLE_NS

    def _answer(self, work: Callable[[NodeService, bytes], bytes], query: Any) -> None:
        """Answers a question of the tracker that is served; a thread of its own."""
        service = self._service
        try:
            if service is None:
                raise VsenseError("serves no tracker")
            data = work(service, query.payload.to_bytes())
            service.heard_ns = self._clock()
        except VsenseError as error:
            refuse(query, str(error))
        except _UNSERVED as error:
            refuse(query, f"asked for what it does not have: {error!r}")
        else:
            reply(query, data)

    def _read(self, service: NodeService, question: bytes) -> bytes:
        session, number, place = map(int, parse_json(question.decode()))
        if session != service.session:
            raise VsenseError("asked in another session")
        return service.preview(service.read(number, place))

    def _look(self, service: NodeService, question: bytes) -> bytes:
        expectation = decode_expectation(question)
        service.take(expectation)
        now_ns, frames = expectation.capture_ns, []
        for number, (_, place) in expectation.turns.items():
            image, camera = service.read(number, place), service.cameras[number].id
            frames.append(Frame(camera, image, 0, now_ns, now_ns, place))
        found = service.look(frames, now_ns)
        self._tell(service, service.troubles(frames, found, True))
        return self._rows(service, expectation.number, frames, found)
