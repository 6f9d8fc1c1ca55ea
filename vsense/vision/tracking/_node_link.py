"""One node, as the tracker has it: its clock, its newest rows, and what it is asked for.

Rows count once and in their order, from the session that the tracker has opened, and only where
their times can be. Whatever else comes under the node's keys is counted and told, and changes
nothing.
"""

from __future__ import annotations

import json
import secrets
import threading
from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from statistics import median
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Found, Image
from vsense.base.errors import VsenseError
from vsense.base.files import parse_json
from vsense.base.native import ffi, lib
from vsense.base.terminal import printable
from vsense.vision.cameras._camera_array import CameraArray
from vsense.vision.cameras.grabber import CameraEvent
from vsense.vision.cameras.picture import PictureError, decode
from vsense.vision.tracking._node_rows import (
    NODE_FORMAT,
    Expectation,
    NodeError,
    SeenRows,
    decode_rows,
    encode_expectation,
)
from vsense.vision.tracking._prediction import MarkerSearch, Prediction
from vsense.vision.tracking._rows import is_in
from vsense.vision.tracking.node_session import NodeRefusal, answer_of, ask, hear, node_key, put
from vsense.vision.tracking.recorded_tracker import Description, seen_by

CONNECT_S = 2.0
"""A node answers within this time, or is asked again."""
AGAIN_NS = 300_000_000
LATE_NS = 25_000_000
"""Rows that may be so much older than the quickest node's are left out."""
AHEAD_NS = 5_000_000
"""A picture may be dated so far after it came, beyond what the clocks are known to."""
OLD_NS = 2_000_000_000
NEAR_M = 0.5
"""A node is told of robots so far around what its cameras see of the floor."""
_DELAYS = 20
_MOST_EVENTS, _MOST_TEXT = 64, 300
_MOST_PREVIEW_BYTES, _MOST_PREVIEW_PX = 1 << 20, 1 << 20
EVENT_KINDS = "dark light saturated exposed frozen running moved steady damaged whole size fits"
EVENT_KINDS += " control slow prompt gone back clock"
"""What nodes say of their cameras; what follows from rows the tracker finds out itself."""


def families_of(searches: Sequence[MarkerSearch]) -> list[str]:
    """The names of the families that are searched, in the order of their numbers."""
    return list(dict.fromkeys(search.family.name for search in searches))


class NodeClock:
    """How far a node's clock is ahead, with its bound: the estimator of the robots' link.

    Zenoh's threads and the tracker's use it.
    """

    def __init__(self) -> None:
        self._clock, self._busy = ffi.new("struct vs_clock *"), threading.Lock()
        lib.vs_clock_init(self._clock, 0)

    def sample(self, seen: SeenRows, now_ns: int) -> None:
        """Takes a message that came at `now_ns`, by the tracker's clock."""
        held_us = max(seen.held_ns, 0) // 1000
        if seen.echo_ns > 0 and held_us < 1 << 32 and seen.sent_ns > 0:
            # One that claims what cannot be is no sample, and that is all.
            with self._busy:
                lib.vs_clock_sample(self._clock, seen.echo_ns, seen.sent_ns, held_us, now_ns)

    def estimate(self, now_ns: int) -> tuple[int, int] | None:
        """Returns the node's clock minus the tracker's, and its error's bound [ns]; None: none."""
        offset, bound = ffi.new("int64_t *"), ffi.new("uint64_t *")
        with self._busy:
            known = lib.vs_clock_estimate(self._clock, now_ns, offset, bound) >= 0
        return (int(offset[0]), int(bound[0])) if known else None


class Arrived(NamedTuple):
    """What has come of a picture; times by the tracker's clock [ns].

    `late_ns` is how much later than the quickest node's it is, where that is too much; else 0.
    """

    capture_ns: int
    arrived_ns: int
    found: Found
    late_ns: int


class NodeLink:
    """One node.

    Attributes:
        name: The node's.
        cameras: Its cameras, in the order of their numbers.
        searches: What is looked for by each.
        counts: Messages and bytes that came, and what was refused, by what it is.
        clock: The node's.
        number: Of the newest expectation.
    """

    def __init__(
        self,
        session: Any,
        arena: str,
        name: str,
        data: Description,
        grabbers: Sequence[str],
        live: bool,
        clock: Callable[[], int],
        quickest_ns: Callable[[], int],
    ) -> None:
        """Listens to a node, and asks it for nothing yet; `session` is Zenoh's.

        `data` is the tracker that its cameras are for, `grabbers` are the node's names of them;
        `quickest_ns` says how old rows of its quickest peer are; `clock` is the host's [ns].
        """
        self.name, self.live = name, live
        self.cameras, self.searches, _ = seen_by(data)
        self._array = CameraArray(self.cameras)
        self.counts, self.clock = Counter[str](), NodeClock()
        self.session = self.number = 0
        self._zenoh, self._data, self._grabbers = session, data, list(grabbers)
        self._now, self._quickest_ns = clock, quickest_ns
        self._tracker, self._here = secrets.randbits(56), set[str]()
        self._newest_rows, self.heard_ns, self._asked_ns = -1, 0, 0
        self._connecting, self._news = threading.Lock(), threading.Condition()
        self._arrived = dict[int, Arrived]()
        self._previews, self._images = dict[int, bytes](), dict[int, Image]()
        self._events = deque[CameraEvent](maxlen=_MOST_EVENTS)
        self._delays_ns = deque[int](maxlen=_DELAYS)
        self.key = partial(node_key, arena, name)
        self._heard = [
            hear(session, self.key("rows"), self._take_rows),
            hear(session, self.key("events"), self._take_events),
            hear(session, self.key("preview/*"), self._take_preview),
        ]

    def meet(self, id: str, is_here: bool) -> None:
        """Takes note that a node of this name is there, or is not any more."""
        self._here = self._here | {id} if is_here else self._here - {id}

    def check_name(self) -> None:
        """Raises NodeRefusal where several nodes have the name: each has cameras of its own."""
        if len(self._here) > 1:
            words = f"{len(self._here)} nodes are called {self.name}"
            raise NodeRefusal(f"{words}, expected one: give each its own --name")

    def connect(self) -> dict[str, Any]:
        """Has the node look at its pictures for this tracker; returns what it answers.

        Nothing where it does. Raises VsenseError: it does not answer, or refuses.
        """
        with self._connecting:
            now_ns = self._now()
            if self.live and self.session and now_ns - self.heard_ns < AGAIN_NS:
                return {}
            if now_ns - self._asked_ns < AGAIN_NS:
                raise VsenseError(f"node {self.name} does not answer")
            self.check_name()
            self._asked_ns = now_ns
            session = secrets.randbits(56)
            setup = {
                "format": NODE_FORMAT,
                "tracker": self._tracker,
                "session": session,
                "live": self.live,
                "grabbers": self._grabbers,
                "tracking": self._data,
            }
            asked = ask(self._zenoh, self.key("open"), json.dumps(setup).encode(), CONNECT_S)
            try:
                answer: dict[str, Any] = parse_json(answer_of(asked, self.name).decode())
            except ValueError as error:
                raise VsenseError(f"node {self.name}: no answer of a node: {error}") from None
            # A node's own clock begins anew with it.
            self.clock, self._newest_rows, self.session = NodeClock(), -1, session
            self._asked_ns, self.heard_ns = 0, self._now()
        if self.live:
            self._greet()
        return answer

    def ask(self, part: str, question: bytes, timeout_s: float) -> Any:
        """Asks for a part of what it has; see `answer_of`."""
        self.counts["bytes to it"] += len(question)
        return ask(self._zenoh, self.key(part), question, timeout_s)

    def expectation(
        self,
        prediction: Prediction,
        capture_ns: int,
        is_key: bool,
        turns: Mapping[int, tuple[int, int]],
    ) -> bytes:
        """Returns the next expectation; see `Expectation` for the arguments."""
        self.number += 1
        now_ns, heights_m = self._now(), prediction.heights_m
        estimate = None if capture_ns else self.clock.estimate(now_ns)
        known, gone = prediction.known, None
        if not capture_ns:
            gone = not is_in(np.array(list(heights_m), dtype=np.int32), known["tag"]).all()
            # Without its clock nobody knows where robots are when it takes its pictures.
            known = known[self._near(known)] if estimate is not None else known[:0]
        return encode_expectation(
            Expectation(
                session=self.session,
                number=self.number,
                sent_ns=now_ns,
                capture_ns=capture_ns,
                offset_ns=0 if estimate is None else estimate[0],
                is_key_frame=is_key,
                gone=gone,
                known=known,
                heights_m=np.array([heights_m.get(tag, 0.0) for tag in known["tag"].tolist()]),
                turns=turns,
                joined=[
                    (number, tag, heights_m.get(tag, 0.0))
                    for number, family in enumerate(families_of(self.searches))
                    for tag in prediction.joined.get(family, ())
                ],
            )
        )

    def _near(self, known: NDArray[np.void]) -> NDArray[np.bool_]:
        """Tells which (n,) KNOWN robots may come into its pictures before they are lost."""
        left, right, below, above = self._array.ground(0.0).T[..., np.newaxis]
        inside = (known["x_m"] > left - NEAR_M) & (known["x_m"] < right + NEAR_M)
        inside &= (known["y_m"] > below - NEAR_M) & (known["y_m"] < above + NEAR_M)
        return np.asarray(inside.any(axis=0))

    def say(self, part: str, data: bytes) -> None:
        """Says something to the node that is worth nothing later; never waits."""
        self.counts["bytes to it"] += len(data)
        put(self._zenoh, self.key(part), data)

    def wait(self, camera: int, timeout_s: float) -> Arrived | None:
        """Waits for the newest rows of a camera that were not taken yet; None: none came."""
        with self._news:
            self._news.wait_for(lambda: camera in self._arrived, timeout_s)
            return self._arrived.pop(camera, None)

    def image(self, camera: int) -> Image:
        """The newest preview in the size of the camera's pictures; black before the first."""
        size = self.cameras[camera].width_px, self.cameras[camera].height_px
        data = self._previews.pop(camera, None)
        if data is not None:
            try:
                small = decode(data, "its preview", _MOST_PREVIEW_PX)
                self._images[camera] = np.asarray(cv2.resize(small, size), dtype=np.uint8)
            except PictureError as error:
                self._refuse(str(error))
        if camera not in self._images:
            self._images[camera] = np.broadcast_to(np.uint8(0), size[::-1])
        return self._images[camera]

    def show(self, camera: int, data: bytes) -> None:
        """Takes a camera's preview, a JPEG."""
        if len(data) <= _MOST_PREVIEW_BYTES:
            self._previews[camera] = data

    def delay_ns(self, now_ns: int) -> int | None:
        """How old its rows are when they come, usually and now; None: unknown, or it is silent."""
        if not self._delays_ns or now_ns - self.heard_ns > AGAIN_NS:
            return None
        # What delays all of them, such as a busy network, makes none of them late.
        return max(int(median(self._delays_ns)), self._delays_ns[-1])

    def events(self) -> list[CameraEvent]:
        """Returns what happened to its cameras since the last call."""
        with self._news:
            events, self._events = list(self._events), deque(maxlen=_MOST_EVENTS)
        return events

    def close(self) -> None:
        """Listens no more, and lets the node know."""
        for heard in self._heard:
            heard.undeclare()
        if self.session:
            put(self._zenoh, self.key("leave"), str(self.session).encode(), urgent=False)

    def _greet(self) -> None:
        """Says what time it is; the rows that answer that date themselves and all later ones."""
        self.say("expect", self.expectation(Prediction(), 0, True, {}))

    def _take_rows(self, sample: Any) -> None:
        """Takes a message of rows; a thread of Zenoh's."""
        now_ns, data = self._now(), sample.payload.to_bytes()
        self.counts["messages"] += 1
        self.counts["bytes from it"] += len(data)
        # A stranger's rows come by another thread than the node's.
        with self._news:
            try:
                self._accept(decode_rows(data, self.session, self.cameras, self.searches), now_ns)
            except NodeError as error:
                self._refuse(str(error))

    def _accept(self, seen: SeenRows, now_ns: int) -> None:
        """Takes rows whose numbers and times can be; NodeError: others. `_news` is held."""
        if seen.number <= self._newest_rows:
            raise NodeError("rows that came before")
        self.clock.sample(seen, now_ns)
        estimate = self.clock.estimate(now_ns)
        if estimate is None:
            self._greet()
        else:
            offset_ns, bound_ns = estimate
            arrived = {
                picture.camera: self._dated(picture.capture_ns - offset_ns, bound_ns, now_ns)
                for picture in seen.pictures
            }
            for picture in seen.pictures:
                capture_ns, late_ns = arrived[picture.camera]
                self._arrived[picture.camera] = Arrived(capture_ns, now_ns, picture.found, late_ns)
            self._news.notify_all()
        self._newest_rows, self.heard_ns = seen.number, now_ns

    def _dated(self, capture_ns: int, bound_ns: int, now_ns: int) -> tuple[int, int]:
        """Returns a picture's capture time, and how much too late it has come; NodeError."""
        if not now_ns - OLD_NS < capture_ns < now_ns + bound_ns + AHEAD_NS:
            off_s = 1e-9 * (capture_ns - now_ns)
            raise NodeError(f"rows of a picture that was taken {off_s:+.2f} s from now")
        delay_ns = now_ns - capture_ns + bound_ns
        self._delays_ns.append(delay_ns)
        behind_ns = delay_ns - self._quickest_ns()
        self.counts["pictures"] += 1
        self.counts["left out"] += behind_ns > LATE_NS
        return min(capture_ns, now_ns), behind_ns if behind_ns > LATE_NS else 0

    def _take_events(self, sample: Any) -> None:
        try:
            session, rows = parse_json(sample.payload.to_bytes().decode())
            if session != self.session or not session:
                raise ValueError("of another session")
            for camera, kind, text in rows[:_MOST_EVENTS]:
                if kind not in EVENT_KINDS.split():
                    raise ValueError("of a kind that no node has")
                self._note(self.cameras[int(camera)].id, str(kind), str(text)[:_MOST_TEXT])
        except (ValueError, TypeError, LookupError):
            self._refuse("an event that none of its cameras has")

    def _take_preview(self, sample: Any) -> None:
        number = str(sample.key_expr).rpartition("/")[2]
        if number in map(str, range(len(self.cameras))):
            self.show(int(number), sample.payload.to_bytes())
        else:
            self._refuse("a preview of a camera that it does not have")

    def _refuse(self, reason: str) -> None:
        self.counts["refused"] += 1
        self._note(self.cameras[0].id, "refused", f"node {self.name}: refused {reason}")

    def _note(self, camera: str, kind: str, text: str) -> None:
        with self._news:
            self._events.append(CameraEvent(camera, kind, printable(text)))
