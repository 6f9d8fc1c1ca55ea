"""Plays a recording: the same messages again, at their pace or another, from anywhere."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from vsense.base.clock import host_ns
from vsense.base.message_bus import Message, MessageBus
from vsense.monitor.recording import form
from vsense.monitor.recording.form import Data
from vsense.monitor.recording.measures import RecordedMeasures
from vsense.monitor.recording.reader import Recording, open_recording, read_gap
from vsense.run.control import State
from vsense.run.orders import Order, OrderError, OrderKind

SLOWEST_REPLAY, FASTEST_REPLAY = 0.1, 100.0
RUN_NS = 250_000_000
"""`/run` is published this often while the recording plays."""
IDLE_PERIOD_NS = 1_000_000_000
"""And this often while it does not."""
PICTURE_NS = 250_000_000
"""Each camera's pictures are published this far apart, as in a run."""
LATE_NS = 1_000_000_000
"""A player that is later than this does not catch up."""
AFTER_NS = 1000
"""A replay begins so long after its first arena state, which is shown then."""
_RUNNING = State.RUNNING.value
_BURST = 50
_CAN = ["play", "pause", "speed", "seek"]
_PASSING = ("/event", form.GAP)
"""News of a moment: not published again to later listeners."""


class Player:
    """Plays one recording; begins paused. `clock` is monotonic [ns].

    The recording is used by this player alone from now on; it is not closed here.
    """

    def __init__(
        self,
        recording: Recording,
        bus: MessageBus,
        clock: Callable[[], int] = host_ns,
    ) -> None:
        self._recording = recording
        self._bus = bus
        self._clock = clock
        end = recording.run
        self._judged = {"verdict": end.verdict, "why": end.why}
        self._has_pictures = any(topic.startswith(form.PICTURE) for topic in recording.topics)
        self._duration_ns = round(1e9 * recording.duration_s)
        self._orders = threading.Condition()
        self._playing = False
        self._speed = 1.0
        self._from_ns, self._anchor_ns = 0, clock()
        self._seeking, self._changed, self._closed = True, True, False
        self._coming: Iterator[Message] = iter(())
        self._next: Message | None = None
        self._current: dict[str, Message] = {}
        self._joined = bus.joined
        self._published_ns = self._reached_ns = self._begin_ns = 0
        self._shown_ns: dict[str, int] = {}
        self._threads: list[threading.Thread] = []
        self._histories: dict[int, Data] = {}
        self._history_shown: tuple[Any, int, bool] | None = None

    def start(self) -> None:
        """Goes on in its own thread, until `close`; shows the first arena state until PLAY."""
        self._from_ns = self._begin_ns = self._first_ns() + AFTER_NS
        for work in (self._run, self._measure):
            self._threads.append(threading.Thread(target=work, name="replay", daemon=True))
            self._threads[-1].start()

    def _first_ns(self) -> int:
        """Where a run begins, and arena and robots in it are known; 0 is the recording's begin.

        What robots did before the run is in many recordings, and not what people look for.
        """
        at_ns = self._next_ns("/run", 0, lambda data: data.get("state") == _RUNNING)
        if at_ns is None:
            at_ns = self._next_ns("/experiment", 0) or 0
        runs = lambda data: data.get("run_timestep") != -1  # noqa: E731
        for topic in ("/arena", "/robots"):
            at_ns = self._next_ns(topic, at_ns, runs) or at_ns
        return at_ns

    def _next_ns(
        self,
        topic: str,
        from_ns: int,
        fits: Callable[[Mapping[str, Any]], bool] = lambda data: True,
    ) -> int | None:
        """When the first message of a topic comes that fits, since the recording's begin [ns]."""
        messages = self._recording.messages({topic}, from_ns / 1e9)
        message = next((message for message in messages if fits(message.data)), None)
        return None if message is None else message.time_ns - self._recording.begin_ns

    def close(self) -> None:
        """Ends the threads."""
        with self._orders:
            self._closed = True
            self._orders.notify()
        for thread in self._threads:
            thread.join()

    def give(self, order: Order) -> str:
        """Carries out PLAY, PAUSE, SPEED and SEEK; OrderError for others; see `Give`."""
        carry_out = {
            OrderKind.PLAY: lambda: self._play(order.value != 0.0),
            OrderKind.PAUSE: lambda: self._play(False),
            OrderKind.SPEED: lambda: self._set_speed(order.value),
            OrderKind.SEEK: lambda: self._seek(order.value),
        }.get(order.kind)
        if carry_out is None:
            raise OrderError(f"{order.kind.value}: a replay can only {', '.join(_CAN)}")
        with self._orders:
            text = carry_out()
            self._changed = True
            self._orders.notify()
        return text

    def step(self) -> int:
        """Publishes what is due; gives the time until the next is due, unless orders come [ns]."""
        now_ns = self._clock()
        with self._orders:
            position_ns = self._position_ns()
            seeking, self._seeking = self._seeking, False
            changed, self._changed = self._changed, False
            playing = self._playing
        if seeking:
            self._begin_at(position_ns)
            # First: who follows the time knows that what comes now is of another.
            self._publish_run(now_ns)
        if seeking or self._bus.joined != self._joined:
            self._publish_all()
            changed = True
        wait_ns = self._publish_due(position_ns) if playing else IDLE_PERIOD_NS
        age_ns = now_ns - self._published_ns
        period_ns = RUN_NS if playing else IDLE_PERIOD_NS
        if changed or age_ns >= period_ns:
            self._publish_run(now_ns)
        return min(wait_ns, period_ns)

    def _run(self) -> None:
        while not self._closed:
            wait_ns = self.step()
            with self._orders:
                if not (self._closed or self._changed):
                    self._orders.wait(wait_ns / 1e9)

    def _measure(self) -> None:
        """Reads the measures of the whole recording, beside what is played of it."""
        with open_recording(self._recording.path) as recording:
            measures = RecordedMeasures(recording.experiment)
            for message in recording.messages(measures.TOPICS):
                measures.take(message)
                if self._closed:
                    return
        with self._orders:
            self._histories, self._changed = measures.data(), True
            self._orders.notify()

    def _position_ns(self) -> int:
        if not self._playing:
            return self._from_ns
        gone_ns = round((self._clock() - self._anchor_ns) * self._speed)
        return min(self._from_ns + gone_ns, self._duration_ns)

    def _anchor(self, position_ns: int) -> None:
        self._from_ns, self._anchor_ns = position_ns, self._clock()

    def _play(self, on: bool) -> str:
        position_ns = self._position_ns()
        if on and not self._playing and position_ns >= self._duration_ns:
            position_ns, self._seeking = self._begin_ns, True
        self._anchor(position_ns)
        self._playing = on
        return f"plays from {position_ns / 1e9:.1f} s" if on else "paused"

    def _set_speed(self, speed: float) -> str:
        if not SLOWEST_REPLAY <= speed <= FASTEST_REPLAY:
            raise OrderError(f"speed: {speed:g}, expected {SLOWEST_REPLAY:g} to {FASTEST_REPLAY:g}")
        self._anchor(self._position_ns())
        self._speed = speed
        return f"plays at {speed:g} times the real speed"

    def _seek(self, to_s: float) -> str:
        if not math.isfinite(to_s):
            raise OrderError(f"seek: {to_s}, expected seconds since the beginning")
        self._anchor(min(max(round(1e9 * to_s), 0), self._duration_ns))
        self._seeking = True
        return f"now at {self._from_ns / 1e9:.1f} s"

    def _begin_at(self, position_ns: int) -> None:
        """Opens the recording at a place, and finds the newest messages there."""
        before_s, self._reached_ns = (position_ns + 1) / 1e9, 0
        self._shown_ns.clear()
        if position_ns > 0:
            self._current = self._recording.newest(self._is_lasting, before_s)
            self._coming = self._recording.messages(self._wants, before_s)
        else:
            self._current = {}
            self._coming = self._recording.messages(self._wants)
        self._next = next(self._coming, None)

    def _is_lasting(self, topic: str) -> bool:
        if topic.startswith(form.PICTURE):
            return self._bus.wants(topic)
        return topic not in _PASSING and topic != form.TRACKER_TOPIC

    def _wants(self, topic: str) -> bool:
        """Whether a message is to be decoded."""
        if topic.startswith(form.PICTURE):
            now_ns = self._clock()
            shown_ns = self._shown_ns.get(topic)
            if shown_ns is not None and now_ns - shown_ns < PICTURE_NS:
                return False
            if not self._bus.wants(topic):
                return False
            self._shown_ns[topic] = now_ns
        return topic != form.TRACKER_TOPIC

    def _publish_due(self, position_ns: int) -> int:
        """Publishes up to a place; gives the time until the next message [ns]."""
        for _ in range(_BURST):
            if self._next is None:
                return self._end(position_ns)
            message = self._next
            at_ns = message.time_ns - self._recording.begin_ns
            if at_ns > position_ns:
                return round((at_ns - position_ns) / self._speed)
            self._publish(message)
            self._next = next(self._coming, None)
            # A recorder that was late has written some messages long after younger ones.
            self._reached_ns = reached_ns = max(self._reached_ns, at_ns)
            if position_ns - reached_ns > LATE_NS * max(self._speed, 1.0) and reached_ns > 0:
                with self._orders:
                    if self._playing and not self._seeking:
                        self._anchor(reached_ns)
                return 0
        return 0

    def _end(self, position_ns: int) -> int:
        """Pauses where the recording ends."""
        if position_ns < self._duration_ns:
            return round((self._duration_ns - position_ns) / self._speed)
        with self._orders:
            if self._playing and not self._seeking:
                self._anchor(self._duration_ns)
                self._playing, self._changed = False, True
        return 0

    def _publish(self, message: Message) -> None:
        topic, data = message.topic, message.data
        if topic == form.GAP:
            return self._publish_gap(message)
        if topic not in _PASSING:
            self._current[topic] = message
        if topic == "/run":
            return self._publish_run(self._clock())
        if topic == "/experiment":
            message = Message(topic, message.time_ns, {**data, "mode": "replay"})
        self._bus.publish(message)
        if topic == "/readings":
            self._publish_readings(message)

    def _publish_readings(self, message: Message) -> None:
        """Publishes the readings of those robots that somebody looks at."""
        columns = {n: c for n, c in message.data.items() if isinstance(c, list)}
        for row, tag in enumerate(columns.get("tag", ())):
            topic = f"/readings/{tag}"
            if self._bus.wants(topic):
                reading = {name: column[row : row + 1] for name, column in columns.items()}
                self._bus.publish(Message(topic, message.time_ns, {**message.data, **reading}))

    def _publish_gap(self, message: Message) -> None:
        """Publishes what is missing here as an event."""
        gap = read_gap(message.data)
        if gap is not None:
            length_s = (gap.to_ns - gap.from_ns) / 1e9
            text = f"here {length_s:.1f} s are not recorded whole: {gap.why}"
            self._bus.event(text, "warning", message.time_ns)

    def _publish_all(self) -> None:
        """Publishes everything that lasts, for a new listener."""
        self._joined = self._bus.joined
        for message in list(self._current.values()):
            if message.topic != "/run":
                self._publish(message)

    def _publish_run(self, now_ns: int) -> None:
        """Publishes `/run` as recorded, with where the replay is."""
        self._published_ns = now_ns
        with self._orders:
            replay: dict[str, Any] = {
                "position_s": self._position_ns() / 1e9,
                "begin_s": self._begin_ns / 1e9,
                "duration_s": self._duration_ns / 1e9,
                "speed": self._speed,
                "playing": self._playing,
                "pictures": self._has_pictures,
            }
        last = self._current.get("/run")
        time_ns = self._recording.begin_ns + round(1e9 * replay["position_s"])
        data = {**(last.data if last else {}), **self._judged, "can": _CAN, "replay": replay}
        self._bus.publish(Message("/run", last.time_ns if last else time_ns, data))
        run = data.get("run")
        version = run, self._bus.joined, run in self._histories
        if version != self._history_shown and run in self._histories:
            self._bus.publish(Message("/history", time_ns, self._histories[run]))
        self._history_shown = version
