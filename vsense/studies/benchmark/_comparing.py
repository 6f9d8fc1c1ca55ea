"""Two labs' results side by side: each mission's runs tested, and what the labs themselves are."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from typing import Any

from vsense.base.errors import UsageError
from vsense.base.files import parse_json, read_text
from vsense.base.terminal import aligned
from vsense.run.runs_csv import COLUMNS, MODES, OPTIONAL, RunRow
from vsense.run.verdict import VALID, VOID
from vsense.studies.benchmark import _definition
from vsense.studies.benchmark._result import FORM, RESULT
from vsense.studies.report import Questions
from vsense.studies.report.study import _words
from vsense.studies.report.study._results import StudyResult, as_json, results_of

COMPARED_COLUMNS = ("series",)

_TYPES: Mapping[str, type | tuple[type, ...]] = {
    **dict.fromkeys(("seed", "robots", "tags", "signal_dbm", "power_saving"), int),
    **dict.fromkeys(("duration_s", "light_level", "late", "batteries_v"), (int, float)),
    "longest_silence_s": (int, float),
}
"""Of values that are no texts."""
_LISTS = ("tags", "uids", "batteries_v", "versions", "power_saving")
_MAY_LACK = ("seed", "duration_s", "robots", "light_level", "late", *OPTIONAL)


@dataclass(frozen=True, slots=True)
class ComparedLabs:
    """What two results give.

    Attributes:
        names: of the labs.
        results: of the labs.
        studies: of each condition of each mission, both labs' runs.
    """

    names: tuple[str, str]
    results: tuple[Mapping[str, Any], Mapping[str, Any]]
    studies: Sequence[StudyResult]
    asked: Questions

    def as_json(self) -> dict[str, Any]:
        """All of it, for scripts."""
        labs = [
            {
                "name": name,
                **{key: result[key] for key in ("site", "mode", "made", "versions", "deviations")},
                "figures": {key: value for key, _, value in own_figures(result)},
            }
            for name, result in zip(self.names, self.results)
        ]
        return {
            "benchmark": self.results[0]["benchmark"],
            "definition_sha256": self.results[0]["definition_sha256"],
            "labs": labs,
            "studies": [as_json(study) for study in self.studies],
        }

    def rows(self) -> list[tuple[str, ...]]:
        """The labs' own figures that one of them has: what, and that of each lab."""
        pairs = zip(*(own_figures(result) for result in self.results))
        return [
            (key, left, right)
            for (key, left, first), (_, right, second) in pairs
            if (first, second) != (None, None)
        ]

    def lines(self) -> Iterator[str]:
        """All of it, for people."""
        yield from aligned([("", *self.names), *self.rows()], left=1)
        for study in self.studies:
            yield ""
            yield f"{study.study.title}: {study.counts}"
            for measure in study.measures:
                yield from (f"  {text}" for text in _words.sentences(study, measure))


def compare(paths: Sequence[Path], independent: bool, tests: bool) -> ComparedLabs:
    """Compares two results; `independent`: runs with the same start make no pairs.

    Raises:
        UsageError: one cannot be read, or they cannot be compared; the message says why.
    """
    (path, first), (other_path, second) = (read(path) for path in paths)
    definition = _definition.load()
    if wrong := _incomparable(first, second) or _unknown(definition.sha256, first):
        raise UsageError(f"{path} and {other_path} cannot be compared: {wrong}")
    names = _names((path, other_path), (first, second))
    rows: list[RunRow] = []
    for name, result in zip(names, (first, second)):
        own = [row_of(run) for run in result["runs"]]
        # A condition's name says which mission it is; who ran it is what differs.
        rows += [replace(row, series=name, mode="", experiment="") for row in own]
    asked = Questions(
        by=COMPARED_COLUMNS,
        independent=independent,
        margins={m.measure: m.margin for m in definition.missions},
        only=[m.measure for m in definition.missions],
        tests=tests,
    )
    return ComparedLabs(names, (first, second), results_of(rows, asked), asked)


def _incomparable(first: Mapping[str, Any], second: Mapping[str, Any]) -> str:
    """Why two results cannot be compared; "": they can."""
    if first.get("quick") or second.get("quick"):
        return "a result of --quick is a first look, and comparable with nothing"
    if first.get("definition_sha256") != second.get("definition_sha256"):
        return f"their definitions differ ({first['benchmark']}, {second['benchmark']})"
    if first.get("deviations") != second.get("deviations"):
        texts = ("; ".join(result.get("deviations") or ["none"]) for result in (first, second))
        return f"they deviate from the definition in different ways ({', '.join(texts)})"
    return ""


def _unknown(sha256: str, result: Mapping[str, Any]) -> str:
    if result.get("definition_sha256") == sha256:
        return ""
    return f"this vsense has another definition than {result['benchmark']}"


def _names(paths: Sequence[Path], results: Sequence[Mapping[str, Any]]) -> tuple[str, str]:
    """What the labs are called; with the mode, and where that is the same their folder, too."""
    first, second = (f"{result.get('site') or 'unnamed'} ({result['mode']})" for result in results)
    if first != second:
        return first, second
    left, right = (path.resolve().parent.name for path in paths)
    names = f"{first} {left}", f"{second} {right}"
    return names if names[0] != names[1] else (f"{first} first", f"{second} second")


def read(path: Path) -> tuple[Path, dict[str, Any]]:
    """Reads a result, or that of a folder; gives its path, too.

    Raises:
        UsageError: it is none, or was written by a newer vsense.
    """
    path = path / RESULT if os.path.isdir(path) else path
    try:
        result = parse_json(read_text(path, most_bytes=256 << 20))
    except OSError as error:
        raise UsageError(f"cannot read {path}: {error.strerror}") from None
    except (UnicodeDecodeError, ValueError) as error:
        raise UsageError(f"{path}: is no {RESULT}: {error}") from None
    kinds = {"form": int, "benchmark": str, "runs": list, "missions": list, "mode": str}
    if not isinstance(result, dict) or any(type(result.get(n)) is not k for n, k in kinds.items()):
        raise UsageError(f"{path}: is no {RESULT}: expected what `vsense benchmark` writes")
    if result["form"] != FORM:
        raise UsageError(f"{path}: has form {result['form']}, this vsense reads {FORM}")
    try:
        _check(result)
    except (KeyError, TypeError, ValueError, AttributeError, IndexError, OverflowError) as error:
        raise UsageError(f"{path}: is damaged: {error!r}") from None
    return path, result


def _check(result: Mapping[str, Any]) -> None:
    """Raises anything where a part that is read has another form than what is written."""
    for run in result["runs"]:
        row_of(run)
    for mission in result["missions"]:
        if not isinstance(mission, dict):
            raise TypeError(f"a mission is {mission!r}, expected an object")
    for name in ("site", "made", "definition_sha256"):
        if not isinstance(result[name], str):
            raise TypeError(f"{name} is {result[name]!r}")
    for name in ("versions", "deviations"):
        if not isinstance(result[name], list) or not all(isinstance(t, str) for t in result[name]):
            raise TypeError(f"{name} is {result[name]!r}")
    for name, _, value in own_figures(result):
        if value is not None and type(value) not in (int, float):
            raise TypeError(f"{name} is {value!r}")


def row_of(run: Mapping[str, Any]) -> RunRow:
    """A run of a result as runs.csv has it; KeyError, TypeError or ValueError: it is damaged."""
    # Results of vsense 0.1 say nothing of links.
    values = {name: run[name] for name in RunRow.__slots__ if name in run or name not in OPTIONAL}
    values.setdefault("power_saving", [])
    for name in _LISTS:
        if not isinstance(values[name], list):
            raise TypeError(f"{name} is {values[name]!r}, expected a list")
    lists = {name: tuple(values[name]) for name in _LISTS}
    row = RunRow(**(values | lists))
    _check_row(row)
    return row


def own_figures(result: Mapping[str, Any]) -> Iterator[tuple[str, str, float | None]]:
    """A lab's own figures: name with its unit, for people, and as a number."""
    latency, truth = result.get("latency") or {}, (result.get("accuracy") or {}).get("truth") or {}
    checks = ((result.get("accuracy") or {}).get("calibration") or {}).get("checks") or [{}]
    stations = latency.get("stations") or {}
    noise = result.get("noise") or {}
    standing = {row["what"]: row["sigma"] for row in noise.get("standing", ())}
    values: dict[str, float | None] = {
        "exposure to readings sent, median [ms]": stations.get("capture_to_sent_ms", {}).get("p50"),
        "exposure to readings sent, p99 [ms]": stations.get("capture_to_sent_ms", {}).get("p99"),
        "exposure to reading on the robot, median [ms]": stations.get(
            "capture_to_robot_ms", {}
        ).get("p50"),
        "exposure to wheels, median [ms]": stations.get("capture_to_wheels_ms", {}).get("p50"),
        "timesteps late or left out [%]": _times(latency.get("late_share_mean"), 100.0),
        "poses against the truth, rms [mm]": truth.get("position_rms_mm"),
        "headings against the truth, rms [deg]": truth.get("heading_rms_deg"),
        "calibrate check, rms [mm]": checks[-1].get("rms_mm"),
        "robots seen in a timestep [%]": _times(
            (result.get("accuracy") or {}).get("seen_share"), 100
        ),
        "noise of a standing robot's x [mm]": standing.get("x"),
        "noise of a standing robot's heading [deg]": standing.get("heading"),
        "noise of its virtual light sensor": standing.get("light"),
        "way over reported, mean of robots": _middle(noise, "way_over_told"),
        "way over reported, spread of robots [%]": _apart(noise, "way_over_told"),
        "noise of way in a timestep [mm]": _middle(noise, "forward_noise_mm"),
        "noise of turn in a timestep [deg]": _middle(noise, "turn_noise_deg"),
    }
    for name, value in values.items():
        yield name, "–" if value is None else f"{value:.4g}", value


def _times(value: float | None, factor: float) -> float | None:
    return None if value is None else factor * value


def _middle(noise: Mapping[str, Any], name: str) -> float | None:
    values = [robot[name] for robot in noise.get("robots", ())]
    return median(values) if values else None


def _apart(noise: Mapping[str, Any], name: str) -> float | None:
    """The greatest less the least of the robots, in percent."""
    values = [robot[name] for robot in noise.get("robots", ())]
    return 100.0 * (max(values) - min(values)) if values else None


def _check_row(row: RunRow) -> None:
    """Raises TypeError or ValueError where a value is not of its column's kind."""
    for name in (*COLUMNS, *OPTIONAL):
        value, kind = getattr(row, name), _TYPES.get(name, str)
        values = value if name in _LISTS else (value,)
        if value is None and name in _MAY_LACK:
            continue
        if any(isinstance(one, bool) or not isinstance(one, kind) for one in values):
            raise TypeError(f"{name} is {value!r}")
    if row.verdict not in (VALID, VOID) or row.mode not in MODES:
        raise ValueError(f"verdict is {row.verdict!r}, mode {row.mode!r}")
    for name, value in row.measures.items():
        if value is not None and type(value) not in (int, float):
            raise TypeError(f"{name} is {value!r}")
