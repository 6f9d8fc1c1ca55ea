"""A recording once more, as others may have it: who and where replaced, pictures left out or kept.

What is compared when a package is made anew stays as it is: arena states, readings, deeds, and
what the tracker is made from.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from vsense.base.errors import failing_as
from vsense.base.message_bus import Message
from vsense.monitor.recording import form
from vsense.monitor.recording.form import ExperimentMessage
from vsense.monitor.recording.foxglove_export import copy_messages
from vsense.monitor.recording.reader import Recording, open_recording
from vsense.monitor.recording.writer import RecordingWriter
from vsense.studies.packages.archive import PackageError
from vsense.studies.packages.scrub import Scrubber


@dataclass(frozen=True, slots=True)
class CopiedRecording:
    """What became of a recording: whether pictures were left out, and what it lacks, in words."""

    left_out: bool
    lacks: Sequence[str]


_TEXTS = ("/experiment", "/run", "/event", "/cameras", form.GAP)
"""Topics in which somebody may be named."""


def copy(
    path: Path,
    into: Path,
    scrubber: Scrubber,
    pictures: bool,
    tell: Callable[[float], None] = lambda share: None,
) -> CopiedRecording:
    """Writes a recording as it goes into a package.

    Raises:
        RecordingError: it is none.
        PackageError: it cannot be written.
    """
    left_out = False
    topics: set[str] = set()

    def change(message: Message) -> Message | None:
        nonlocal left_out
        topics.add(message.topic)
        if not pictures and message.topic.startswith((form.PICTURE, form.TRACKER)):
            left_out = True
            return None
        return _scrubbed(message, scrubber)

    with open_recording(path) as recording, failing_as(PackageError, f"{into}: cannot be written"):
        writer = RecordingWriter(into, recording.begin_ns, recording.utc_shift_ns)
        copy_messages(recording, writer, tell, change)
        lacks = _lacks(recording, topics, left_out)
    return CopiedRecording(left_out, lacks)


def _lacks(recording: Recording, topics: Collection[str], left_out: bool) -> list[str]:
    """What a recording lacks, that was read with these topics."""
    experiment, lacks = ExperimentMessage.read(recording.experiment), []
    if gaps := recording.gaps:
        many = f"{len(gaps)} gaps" if len(gaps) > 1 else "a gap"
        lacks.append(f"has {many} ({gaps[0].why}): only what is beside can be made anew")
    if not recording.complete:
        lacks.append("was cut off: its last second may be missing")
    if recording.damaged:
        lacks.append(f"{len(recording.damaged)} parts of it are damaged")
    if experiment.mode == "sim" or form.DEEDS not in topics:
        return lacks
    if experiment.made is None:
        lacks.append("does not say how its experiment was read: readings cannot be made anew")
    if left_out:
        lacks.append("its pictures were left out (--pictures): poses cannot be tracked again")
    elif form.TRACKER not in topics:
        lacks.append("has no pictures (--record-images): poses cannot be tracked again")
    return lacks


def _scrubbed(message: Message, scrubber: Scrubber) -> Message:
    if message.topic not in _TEXTS:
        return message
    data = dict(message.data)
    made = data.pop("made", None)
    text = data.pop("file_text", None)
    data = {**scrubber.data(data), **({"user": None} if "user" in data else {})}
    if made is not None:
        data["made"] = scrubber.setup(made)
    if isinstance(text, str):
        data["file_text"] = scrubber.text(text)
    return replace(message, data={name: data[name] for name in message.data})
