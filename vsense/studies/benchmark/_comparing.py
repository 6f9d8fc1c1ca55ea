"""Two labs' results side by side: each mission's runs tested, and what the labs themselves are."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from vsense.base.errors import UsageError
from vsense.base.terminal import aligned
from vsense.run.runs_csv import RunRow
from vsense.studies.benchmark import _definition
from vsense.studies.benchmark._result import own_figures, read, row_of
from vsense.studies.report import Questions
from vsense.studies.report.study import _words
from vsense.studies.report.study._results import StudyResult, as_json, results_of

COMPARED_COLUMNS = ("series",)


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
