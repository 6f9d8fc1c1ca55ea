"""The tracker's end of cameras on other computers: a detector, sources and recordings by wire.

Of live cameras each node looks at its pictures when they come, with the newest expectation. What
it has found comes like a picture from a camera (`NodeSource`), dated by the measured offset of the
node's clock. Of recordings the tracker asks for every picture (`NodeRecording`), and for what is in
it with the very expectation of its timestep (`NodeDetector`): the states are those of one computer.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from vsense.base.arena import Found, Image
from vsense.base.errors import GrabberError, VsenseError
from vsense.vision.cameras._recorded_grabber import CameraRecording
from vsense.vision.cameras._recordings import CaptureTime
from vsense.vision.cameras.camera import Camera
from vsense.vision.cameras.grabber import CameraEvent
from vsense.vision.cameras.picture import LatePicture, PictureError
from vsense.vision.cameras.source import Shot, Source, silence_s
from vsense.vision.tracking._detector import Detector
from vsense.vision.tracking._joining import UnlistedTags
from vsense.vision.tracking._node_link import OLD_NS, NodeLink
from vsense.vision.tracking._node_rows import decode_rows
from vsense.vision.tracking._prediction import Prediction
from vsense.vision.tracking._workers import Picture
from vsense.vision.tracking.marker_detector import Detected
from vsense.vision.tracking.node_session import (
    NodeRefusal,
    answer_of,
    node_key,
    open_network,
)
from vsense.vision.tracking.recorded_tracker import of_session
from vsense.vision.tracking.specs import CameraTrackerSpec, GrabberSpec, TrackingSession

ANSWER_S = 10.0
"""A node has this time to come at the start, and to answer a question about a recording."""
REFUSED_S = 2.5
"""A node keeps a tracker for less."""
_ASK_AGAIN_S, _ASKED_AGAIN = 0.4, 4


class Nodes:
    """All nodes of a tracking session.

    Attributes:
        cameras: Ids of the cameras whose pictures stay there.
        links: By the node's name.
    """

    def __init__(
        self, session: TrackingSession, clock: Callable[[], int], say: Callable[[str], None]
    ) -> None:
        """Opens the network for the views of a session that nodes have; some have one.

        Raises:
            ConfigError: All pictures are to be recorded.
            UsageError, VsenseError: Zenoh is missing, or cannot listen or begin.
        """
        self._clock, self._ended = clock, threading.Event()
        views: dict[str, list[CameraTrackerSpec]] = {}
        for view in session.views:
            if view.grabber.node:
                views.setdefault(view.grabber.node, []).append(view)
        self._session, self._views = session, views
        self.cameras = frozenset(v.camera.id for group in views.values() for v in group)
        network = session.resources.network
        assert network is not None
        if session.record.record_image:
            text = "<experiment_record> record_image: pictures of nodes' cameras stay there"
            raise session.error(session.record.line, text)
        mode = "peer" if network.listen else "client"
        self._zenoh, self._say = open_network(network, mode), say
        self.links: dict[str, NodeLink] = {}
        self._places: dict[str, tuple[NodeLink, int]] = {}
        for name, group in views.items():
            ids = [view.camera.id for view in group]
            say(
                f"pictures of {', '.join(ids)} stay at node {name}: here they are coarse, and not"
                " recorded"
            )
            data = of_session(replace(session, views=tuple(group)))
            about = data, [view.grabber.source for view in group], session.is_live
            where = self._zenoh, network.arena, name
            link = self.links[name] = NodeLink(
                *where, *about, clock, partial(self._quickest_ns, name)
            )
            self._places.update((id, (link, number)) for number, id in enumerate(ids))
        here, lively = node_key(network.arena, "*", "here/*"), self._zenoh.liveliness()
        self._strangers = lively.declare_subscriber(here, self._greet, history=True)

    def place_of(self, camera: str) -> tuple[NodeLink, int]:
        """The node that has a camera, and the camera's number there."""
        return self._places[camera]

    def source(self, camera: str, spec: GrabberSpec) -> Source:
        """Returns a camera that a node has."""
        return NodeSource(*self._places[camera], spec.frame_rate_hz)

    def recordings(self) -> dict[str, CameraRecording]:
        """Returns the recordings that nodes have, by the camera's id.

        Raises:
            ConfigError: A node does not come, or does not have them; names the place.
        """
        recordings: dict[str, CameraRecording] = {}
        for name, group in self._views.items():
            link = self.links[name]
            try:
                taken = self._await(link)["taken"]
                for number, view in enumerate(group):
                    times = [CaptureTime(str(p), t, int(ns)) for p, t, ns in taken[number]]
                    recordings[view.camera.id] = NodeRecording(link, number, times)
            except (VsenseError, KeyError, TypeError, ValueError, IndexError) as error:
                text = str(error) if isinstance(error, VsenseError) else f"node {name}: no times"
                message = f"<grabber> node: {text}"
                raise self._session.resources.error(group[0].grabber.line, message) from None
        return recordings

    def detectors(self, prediction: Prediction) -> dict[str, Detector]:
        """See `DetectorMaker.detectors`."""
        return dict.fromkeys(self.cameras, NodeDetector(self, prediction))

    def events(self) -> list[CameraEvent]:
        """Returns what happened to the nodes' cameras since the last call."""
        return [event for link in self.links.values() for event in link.events()]

    def close(self) -> None:
        """Leaves the nodes and the network; can be called again."""
        if not self._ended.is_set():
            self._ended.set()
            for link in self.links.values():
                link.close()
            self._zenoh.close()

    def _await(self, link: NodeLink) -> dict[str, Any]:
        """Asks a node until it answers; one may still serve a tracker that was killed."""
        begin_ns = self._clock()
        while True:
            try:
                return link.connect()
            except VsenseError as error:
                patience_s = REFUSED_S if isinstance(error, NodeRefusal) else ANSWER_S
                if self._clock() > begin_ns + 1e9 * patience_s:
                    raise
                self._ended.wait(_ASK_AGAIN_S)

    def _quickest_ns(self, name: str) -> int:
        """How old rows usually are when they come from the quickest of a node's peers."""
        now_ns = self._clock()
        known = [link.delay_ns(now_ns) for peer, link in self.links.items() if peer != name]
        return min((delay_ns for delay_ns in known if delay_ns is not None), default=OLD_NS)

    def _greet(self, sample: Any) -> None:
        """Tells of nodes that nobody has listed, and of those of one name."""
        _, _, name, _, id = str(sample.key_expr).split("/")
        is_here, link = str(sample.kind).endswith("PUT"), self.links.get(name)
        if link is not None:
            link.meet(id, is_here)
            try:
                link.check_name()
            except NodeRefusal as error:
                self._say(str(error))
        elif is_here:
            self._say(f"node {name} is there, and no <grabber> names it: nothing of it is taken")


class NodeSource:
    """A camera that a node has: instead of pictures there come coarse ones, and what is in them."""

    def __init__(self, link: NodeLink, number: int, rate_hz: float | None) -> None:
        self._link, self._number = link, number
        self._silence_s = silence_s(rate_hz)
        self._first = True

    def open(self) -> list[str]:
        """See `Source.open`."""
        if not self._link.session:
            self._connect()
        self._first = True
        return []

    def read(self) -> Shot:
        """See `Source.read`."""
        link, number = self._link, self._number
        arrived = link.wait(number, self._silence_s)
        for _ in range(_ASKED_AGAIN if self._first and arrived is None else 0):
            # It may have been cut off, and go on by itself; or begin anew, and has to be asked.
            self._connect()
            arrived = link.wait(number, _ASK_AGAIN_S)
            if arrived is not None:
                break
        if arrived is None:
            raise GrabberError(f"node {link.name} silent for {self._silence_s:g} s")
        self._first = False
        if arrived.late_ns:
            raise LatePicture(
                f"node {link.name} is {1e-6 * arrived.late_ns:.0f} ms behind the quickest: what it"
                " sees is left out, and not waited for"
            )
        capture_ns, arrived_ns, found, _ = arrived
        return Shot(link.image(number), None, arrived_ns, capture_ns, found)

    def close(self) -> None:
        """Does nothing: the node's other cameras go on."""

    def _connect(self) -> None:
        try:
            self._link.connect()
        except VsenseError as error:
            raise GrabberError(str(error)) from None


class NodeRecording:
    """One camera's recording that a node has; see `CameraRecording`."""

    def __init__(self, link: NodeLink, number: int, taken: Sequence[CaptureTime]) -> None:
        self.taken = taken
        self._link, self._number = link, number

    def read(self, place: int) -> Image:
        """Has the node read a picture; returns a coarse one of the same size."""
        link = self._link
        question = json.dumps([link.session, self._number, place]).encode()
        try:
            preview = answer_of(link.ask("read", question, ANSWER_S), link.name)
        except NodeRefusal as error:
            raise PictureError(str(error)) from None
        except VsenseError as error:
            raise GrabberError(str(error)) from None
        link.show(self._number, preview)
        return link.image(self._number)

    def close(self) -> None:
        """Does nothing."""


class NodeDetector:
    """The detector of all cameras that nodes have; see `Detector`."""

    def __init__(self, nodes: Nodes, prediction: Prediction) -> None:
        """Takes what the arena tracker expects, and says it to nodes with live cameras."""
        self._nodes, self._prediction = nodes, prediction
        prediction.tell(self._say)

    def detect_all(self, pictures: Sequence[Picture]) -> list[Detected]:
        """See `Detector.detect_all`."""
        answers = self._ask([p for p in pictures if p.found is None])
        detected = []
        for picture in pictures:
            found = picture.found or answers[picture.camera.id]
            if len(found.unlisted):
                self._tell(picture.camera, found)
            detected.append(Detected(found.rows, found.full))
        return detected

    def _ask(self, pictures: Sequence[Picture]) -> dict[str, Found]:
        """Has the nodes look for what is expected now, all at once, and waits for them."""
        places: dict[str, dict[int, tuple[int, int]]] = {}
        prediction, answers = self._prediction, {}
        for picture in pictures:
            link, number = self._nodes.place_of(picture.camera.id)
            turn = prediction.turns.get(picture.camera.id, 1)
            places.setdefault(link.name, {})[number] = turn, picture.place
        asked = []
        for name, turns in places.items():
            link = self._nodes.links[name]
            capture_ns, is_key = prediction.capture_ns, prediction.is_key_frame
            question = link.expectation(prediction, capture_ns, is_key, turns)
            asked.append((link, link.ask("detect", question, ANSWER_S)))
        for link, replies in asked:
            data = answer_of(replies, link.name)
            link.counts["bytes from it"] += len(data)
            rows = decode_rows(data, link.session, link.cameras, link.searches)
            for seen in rows.pictures:
                answers[link.cameras[seen.camera].id] = seen.found
        if missing := {p.camera.id for p in pictures} - answers.keys():
            raise VsenseError(f"camera {min(missing)}: its node says nothing of its picture")
        return answers

    def _say(self) -> None:
        """Lets nodes with live cameras know what has been learned."""
        prediction = self._prediction
        for link in self._nodes.links.values():
            if link.live and link.session:
                turns = {n: prediction.turns.get(c.id, 0) + 1 for n, c in enumerate(link.cameras)}
                is_key = prediction.is_next_key_frame
                places = {number: (turn, 0) for number, turn in turns.items()}
                link.say("expect", link.expectation(prediction, 0, is_key, places))

    def _tell(self, camera: Camera, found: Found) -> None:
        """Tells the arena tracker of tags that are on no roster."""
        link, number = self._nodes.place_of(camera.id)
        search, prediction = link.searches[number], self._prediction
        tags = found.unlisted["tag"]
        places = np.stack((found.unlisted["x_m"], found.unlisted["y_m"]), axis=-1)
        roster = [*sorted(search.heights_m), *prediction.joined.get(search.family.name, ())]
        prediction.unlisted[camera.id] = UnlistedTags(
            search.family, roster, search.height_m, tags, places
        )
