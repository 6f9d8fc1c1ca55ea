"""Reads recordings: whole ones by their index, cut-off and damaged ones as far as they go."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from vsense.base.errors import failing_as
from vsense.base.files import open_bytes
from vsense.base.message_bus import DAMAGED, Message
from vsense.monitor.recording import _chunks, form
from vsense.monitor.recording._chunks import ChunkPlace, Contents, DamagedError, Raw, Topic, scan
from vsense.monitor.recording.form import RecordingError, RunMessage

Choice = Collection[str] | Callable[[str], bool] | None
"""Topics by their names or by a test; None: all."""


@dataclass(frozen=True, slots=True)
class Gap:
    """A time, on the host's monotonic clock, of which messages or pictures are missing.

    Their numbers are 0 where they were not counted; `why` is for people.
    """

    from_ns: int
    to_ns: int
    messages: int
    pictures: int
    why: str


class Recording:
    """An open recording; for one thread. All times are those of the host that recorded.

    Attributes:
        version: the vsense that wrote it.
        complete: whether it was ended in order; otherwise its last second may be missing.
        begin_ns, utc_shift_ns: see `form.Head`.
        damaged: chunks that could not be read so far.
    """

    def __init__(self, path: Path, file: BinaryIO, contents: Contents) -> None:
        self.path = path
        self.version = contents.head.version
        self.complete = contents.complete
        self.begin_ns = contents.head.begin_ns
        self.utc_shift_ns = contents.head.utc_shift_ns
        self.damaged: set[int] = set()
        self._file = file
        self._places = contents.places
        self._channels = contents.channels
        self._inside: dict[int, frozenset[int]] = {}
        self._gaps: list[Gap] | None = None
        self._learnt = False

    def __enter__(self) -> Recording:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def close(self) -> None:
        """Closes the file; can be called again."""
        self._file.close()

    @property
    def topics(self) -> frozenset[str]:
        """Topics of which there are messages; of what was cut off, those before the cut."""
        return frozenset(channel.topic for channel in self._channels.values())

    @property
    def duration_s(self) -> float:
        """From its beginning to its last message."""
        end_ns = max((place.end_ns for place in self._places), default=0) - self.utc_shift_ns
        return max(end_ns - self.begin_ns, 0) / 1e9

    @property
    def experiment(self) -> dict[str, Any]:
        """The data of the newest `/experiment`; empty where none was recorded."""
        newest = self.newest({"/experiment"})
        return dict(newest["/experiment"].data) if newest else {}

    @property
    def gaps(self) -> list[Gap]:
        """What is missing, as far as it was noticed while recording."""
        if self._gaps is None:
            marks = (message.data for message in self.messages({form.GAP}))
            self._gaps = [gap for gap in map(read_gap, marks) if gap is not None]
        return self._gaps

    @property
    def run(self) -> RunMessage:
        """The newest `/run`, which has the verdict on a run that came to its end."""
        newest = self.newest({"/run"})
        return RunMessage.read(newest["/run"].data) if newest else RunMessage()

    def lacks(self) -> list[str]:
        """What is wrong with it, a sentence each: its run is invalid, something is missing, or
        damaged, as far as it was read until now."""
        why = self.run.why
        lines = [f"{self.path}: its run is invalid: {why}"] if why else []
        if not self.complete:
            lines.append(f"{self.path} was cut off: its last second may be missing")
        if self.damaged:
            lines.append(f"{len(self.damaged)} parts of {self.path} are damaged")
        if gaps := self.gaps:
            messages, pictures = sum(gap.messages for gap in gaps), sum(g.pictures for g in gaps)
            length_s = sum(gap.to_ns - gap.from_ns for gap in gaps) / 1e9
            more = f" (and {len(gaps) - 1} more)" if len(gaps) > 1 else ""
            lines.append(
                f"{self.path} lacks {messages} messages and {pictures} pictures of"
                f" {length_s:.1f} s: {gaps[0].why}{more}"
            )
        return lines

    def messages(self, topics: Choice = None, start_s: float = 0.0) -> Iterator[Message]:
        """Gives messages of `topics` in the order of the recording, from `start_s` after its
        beginning. What is damaged is left out and noted in `damaged`.
        """
        start_ns = None if start_s <= 0.0 else self.begin_ns + round(1e9 * start_s)
        if start_ns is not None:
            self._learn()
        wanted = _test(topics)
        for place in self._places:
            late = start_ns is None or place.end_ns - self.utc_shift_ns >= start_ns
            if not late or not self._may_hold(place, wanted):
                continue
            for raw in self._unpack(place):
                if start_ns is None or raw.log_ns - self.utc_shift_ns >= start_ns:
                    message = self._decode(place, raw, wanted)
                    if message is not None:
                        yield message

    def newest(self, topics: Choice, before_s: float | None = None) -> dict[str, Message]:
        """Gives the newest message of each topic that was there; before `before_s`, or of all."""
        wanted = _test(topics)
        end_ns = None if before_s is None else self.begin_ns + round(1e9 * before_s)
        messages: dict[str, Message] = {}
        self._learn()
        for place in reversed(self._places):
            if end_ns is not None and place.begin_ns - self.utc_shift_ns >= end_ns:
                continue
            still = lambda topic: wanted(topic) and topic not in messages  # noqa: B023, E731
            if self._may_hold(place, still):
                messages |= self._newest_in(place, still, end_ns)
        return messages

    def _learn(self) -> None:
        """Finds all channels where there is no index: a chunk may use an earlier one's."""
        if not self.complete and not self._learnt:
            self._learnt = True
            for place in self._places:
                for _ in self._unpack(place):
                    pass

    def _newest_in(
        self, place: ChunkPlace, wanted: Callable[[str], bool], end_ns: int | None
    ) -> dict[str, Message]:
        raws: dict[str, Raw] = {}
        for raw in self._unpack(place):
            info = self._channels.get(raw.channel)
            early = end_ns is None or raw.log_ns - self.utc_shift_ns < end_ns
            if early and info is not None and _is_ours(info, wanted):
                raws[info.topic] = raw
        messages = (self._decode(place, raw, wanted) for raw in raws.values())
        return {message.topic: message for message in messages if message is not None}

    def _may_hold(self, place: ChunkPlace, wanted: Callable[[str], bool]) -> bool:
        """Whether a chunk may have messages of such topics."""
        numbers = place.channels or self._inside.get(place.offset)
        if not numbers or not numbers <= self._channels.keys():
            return True
        return any(_is_ours(self._channels[number], wanted) for number in numbers)

    def _unpack(self, place: ChunkPlace) -> Iterator[Raw]:
        """Reads a chunk, message by message: a small file can hold millions.

        One that is damaged gives what it has before the damage.
        """
        with failing_as(RecordingError, f"{self.path}: cannot be read"):
            self._file.seek(place.offset)
            content = self._file.read(place.length)
        inside: set[int] = set()
        try:
            for raw in _chunks.walk(content, self._channels):
                inside.add(raw.channel)
                yield raw
        except DamagedError:
            self.damaged.add(place.offset)
        self._inside[place.offset] = frozenset(inside)

    def _decode(self, place: ChunkPlace, raw: Raw, wanted: Callable[[str], bool]) -> Message | None:
        info = self._channels.get(raw.channel)
        if info is None or not _is_ours(info, wanted):
            return None
        try:
            time_ns = raw.log_ns - self.utc_shift_ns
            return form.decode(info.topic, time_ns, info.blob, bytes(raw.data))
        except (ValueError, TypeError, KeyError, RecursionError):
            self.damaged.add(place.offset)
            return None


def open_recording(path: Path) -> Recording:
    """Opens a recording.

    Raises:
        RecordingError: it is not there, no recording of vsense, of another format, or cut off
            before anything was recorded.
    """
    with failing_as(RecordingError, f"{path}: cannot be read"):
        file = open_bytes(path)
        try:
            return Recording(path, file, scan(file, file.seek(0, 2), str(path)))
        except BaseException:
            file.close()
            raise


def _is_ours(channel: Topic, wanted: Callable[[str], bool]) -> bool:
    """Whether a channel has messages of the run itself, and of a wanted topic."""
    return not channel.derived and wanted(channel.topic)


def _test(topics: Choice) -> Callable[[str], bool]:
    if topics is None:
        return lambda topic: True
    return topics if callable(topics) else frozenset(topics).__contains__


def read_gap(data: Mapping[str, Any]) -> Gap | None:
    """Reads the data of a `/gap`; None: it is damaged."""
    try:
        times = int(data["from_ns"]), int(data["to_ns"])
        return Gap(*times, int(data["messages"]), int(data["pictures"]), str(data["why"]))
    except DAMAGED:
        return None
