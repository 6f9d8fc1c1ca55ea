"""The files that go into a package: which, what they are, and how they are made fit for others.

What is not named here stays out: keys, scripts and logs of single robots know where a lab is.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase

CSV, JSON, PLAIN_TEXT, PNG = "text/csv", "application/json", "text/plain", "image/png"
BINARY, XML, TOML = "application/octet-stream", "application/xml", "application/toml"


@dataclass(frozen=True, slots=True)
class FileKind:
    """A kind of files.

    Attributes:
        pattern: of their names, from the folder of the runs or of the run.
        name, about: what such a file is, in a few words and in a sentence.
        media: its media type.
        scrub: how it is made fit: "text", "paths", "roster", "recording"; "": it goes as it is.
        large: it stays out unless pictures are wanted.
    """

    pattern: str
    name: str
    about: str
    media: str
    scrub: str = ""
    large: bool = False


_RUNS = (
    FileKind("runs.csv", "Table of runs", "A row for each run, with its measures.", CSV, "text"),
    FileKind("plan.toml", "Plan", "What the series compares, as it was begun.", TOML, "text"),
    FileKind("series.json", "Series", "The plan and its files, or figures of runs.", JSON, "paths"),
)
_RUN = (
    FileKind("summary.json", "Figures", "The figures of a run.", JSON, "paths"),
    FileKind("timesteps.csv", "Timesteps", "When each timestep was made.", CSV),
    FileKind("measures.csv", "Measures", "The experiment's measures over time.", CSV),
    FileKind("events.csv", "Events", "What controllers and loop functions logged.", CSV, "text"),
    FileKind("shown.csv", "Shown values", "What controllers showed, when it changed.", CSV, "text"),
    FileKind("trajectory.npz", "Poses", "Where every robot was, as arrays of NumPy.", BINARY),
    FileKind("*.mcap", "Recording", "All messages of a run: poses, readings, deeds and events.",
             "application/octet-stream", "recording"),
    FileKind("log.txt", "Log", "What was said during the run.", PLAIN_TEXT, "text"),
    FileKind("*.argos", "Experiment", "The experiment as it was run.", XML, "text"),
    FileKind("truth.bin", "True poses", "Where every robot of the lab truly was.", BINARY),
    FileKind("actuations.bin", "Commands", "What the wheels of the lab's robots obeyed.", BINARY),
    FileKind("physics.json", "Emulation", "How late the emulation's clock was.", JSON, "paths"),
    FileKind("robots/*.trace", "Control steps", "Every control step of a robot.", PLAIN_TEXT),
    FileKind("cameras/report/*", "Calibration's report", "How true the cameras are.", PLAIN_TEXT),
    FileKind("cameras/*.json", "Camera", "A camera's calibration.", JSON),
    FileKind("cameras/truth/*.json", "True camera", "What a rendered camera truly is.", JSON),
    FileKind("*.png", "Picture of a run", "A run, or a campaign, in one picture.", PNG),
    FileKind("*.webm", "Video", "A video of a run.", "video/webm", "", True),
    FileKind("*.mp4", "Video", "A video of a run.", "video/mp4", "", True),
)  # fmt: skip
_SOURCES = (
    FileKind("*.argos", "Experiment", "The experiment's file.", XML, "text"),
    FileKind("*.xml", "Session", "Cameras and trackers, with their settings.", XML, "text"),
    FileKind("*.toml", "Roster", "The robots, with what was measured of them.", TOML,
             "roster"),
    FileKind("*.c", "Controller", "Source code.", "text/x-c"),
    FileKind("*.cpp", "Source code", "Source code.", "text/x-c++"),
    FileKind("*.h", "Header", "Source code.", "text/x-c"),
    FileKind("*.hpp", "Header", "Source code.", "text/x-c++"),
    FileKind("*.py", "Loop functions", "Source code.", "text/x-python"),
    FileKind("*.json", "Calibration", "A camera's calibration, or data of the experiment.", JSON),
    FileKind("*.csv", "Table", "Data of the experiment.", CSV),
    FileKind("*.png", "Picture", "A picture that the experiment uses.", PNG),
    FileKind("*", "Source", "A file that the experiment names.", BINARY),
)  # fmt: skip

_PASSED_OVER = ("*-made*.zip", "made*.zip", ".*", "*.part")
"""What packing itself reads, or nobody misses."""


def of_runs(name: str) -> FileKind | None:
    """The kind of a file beside several runs; None: it stays out."""
    return _first((*_RUNS, *_RUN), name)


def of_run(name: str) -> FileKind | None:
    """The kind of a file of one run, from its folder; None: it stays out."""
    return _first((*_RUNS[2:], *_RUN), name)


def of_source(name: str) -> FileKind:
    """The kind of a file that runs were made from."""
    kind = _first(_SOURCES, name.rpartition("/")[2])
    assert kind is not None, "the last one takes all"
    return kind


def table(name: str) -> FileKind:
    """The kind of a campaign's table, whatever its name is."""
    return FileKind(name, _RUNS[0].name, _RUNS[0].about, CSV, "text")


def is_passed_over(name: str) -> bool:
    """Whether nobody has to be told that a file stays out."""
    last = name.rpartition("/")[2]
    return any(fnmatchcase(last, pattern) for pattern in _PASSED_OVER)


def _first(kinds: tuple[FileKind, ...], name: str) -> FileKind | None:
    depth = name.count("/")
    for kind in kinds:
        if kind.pattern.count("/") == depth and fnmatchcase(name, kind.pattern):
            return kind
    return None


REPORT_KINDS: Mapping[str, tuple[str, str]] = {
    ".html": ("Report", "text/html"),
    ".svg": ("Figure", "image/svg+xml"),
    ".png": ("Figure", PNG),
    ".json": ("Figures as numbers", JSON),
}
"""Of a report's files, by their ending: what they are, and their media types."""
