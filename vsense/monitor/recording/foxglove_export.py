"""A recording once more: as it is or changed, with Foxglove's channels, and a layout that fits it.

New recordings have these channels already; older ones, and those of an older form, get them here.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from vsense.base.errors import failing_as
from vsense.base.message_bus import DAMAGED, Message
from vsense.monitor.foxglove._layout import as_text, layout
from vsense.monitor.foxglove.channels import Channels
from vsense.monitor.recording.form import PICTURE, ExperimentMessage, RecordingError
from vsense.monitor.recording.reader import Recording
from vsense.monitor.recording.writer import RecordingWriter

_CHUNK_NS = 1_000_000_000
"""A chunk ends after so long: whoever jumps in the file has to unpack no more."""


def export_foxglove(
    recording: Recording, path: Path, progress: Callable[[float], None] = lambda share: None
) -> dict[str, int]:
    """Writes a recording for Foxglove to `path`, and its layout beside it.

    `progress` takes the share that is done, from 0 to 1, now and then. Damaged parts are left out.

    Returns:
        The two files' sizes in bytes, by their paths.

    Raises:
        RecordingError: a file is there already, or cannot be written.
    """
    beside = path.with_name(f"{path.stem}-layout.json")
    for file in (path, beside):
        if os.path.exists(file):
            raise RecordingError(f"{file}: is there already; expected a new file")
    writer = RecordingWriter(path, recording.begin_ns, recording.utc_shift_ns)
    try:
        with failing_as(RecordingError, f"{path}: cannot be written"):
            copy_messages(recording, writer, progress)
        with failing_as(RecordingError, f"{beside}: cannot be written"):
            beside.write_text(as_text(_layout(recording)), encoding="utf-8")
    except BaseException:
        path.unlink(missing_ok=True)
        beside.unlink(missing_ok=True)
        raise
    return {str(file): file.stat().st_size for file in (path, beside)}


def copy_messages(
    recording: Recording,
    writer: RecordingWriter,
    progress: Callable[[float], None] = lambda share: None,
    change: Callable[[Message], Message | None] = lambda message: message,
) -> None:
    """Adds every message and what follows from it, and closes the writer.

    `progress`: see `export_foxglove`; `change` gives what is written in place of a message, None:
    nothing. OSError if the disk does not take it.
    """
    pictures = recording.newest(lambda topic: topic.startswith(PICTURE))
    full_size = any(change(picture) is not None for picture in pictures.values())
    channels = Channels(recording.utc_shift_ns, full_size=full_size)
    begun_ns = recording.begin_ns
    length_ns = max(1e9 * recording.duration_s, 1.0)
    try:
        for original in recording.messages():
            message = change(original)
            if message is None:
                continue
            writer.add(message)
            for derived in channels.convert(message):
                writer.add_derived(derived)
            if writer.is_full or message.time_ns - begun_ns >= _CHUNK_NS:
                begun_ns = message.time_ns
                writer.flush()
                progress(min((message.time_ns - recording.begin_ns) / length_ns, 1.0))
    finally:
        # The file is closed even where its end cannot be written.
        writer.close()


def _layout(recording: Recording) -> dict[str, Any]:
    """The layout for the recording's cameras, fields and arena."""
    experiment = ExperimentMessage.read(recording.experiment)
    cameras = [str(c["id"]) for c in experiment.cameras if isinstance(c, dict) and "id" in c]
    fields: list[str] = []
    sizes: list[float] = []
    with suppress(*DAMAGED):
        newest = recording.newest({"/fields"})
        fields = [str(row["id"]) for row in newest["/fields"].data["fields"]]
    with suppress(*DAMAGED):
        sizes = [float(side) for side in (experiment.arena or {})["size_m"][:2]]
    return layout(cameras, fields, max(sizes, default=3.0))
