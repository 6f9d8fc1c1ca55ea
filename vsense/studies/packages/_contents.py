"""What a package says of itself to `vsense reproduce`: which runs, made from what, and how."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from vsense.base.errors import UsageError, VsenseError
from vsense.base.files import parse_json
from vsense.run.runs_csv import MODES
from vsense.studies.packages._archive import wrong_name

CONTENTS = "vsense-package.json"
MOST_CONTENTS = 4 << 20
"""Bytes of that file: some 5,000 runs."""
NO_RECORDING = "there is no recording of it"
PACKAGE_FORMAT = 1
"""Rises when an older vsense can no longer reproduce what is written."""
SETUP_FILE = "made.json"
"""In a folder of sources: setups by key, and what machine it was."""


@dataclass(frozen=True, slots=True)
class PackedRun:
    """A run in a package; names of files are those of the package.

    Attributes:
        row: its number in the table.
        folder: of its files, "": it has none.
        sources: folder of what it was made from, "": nobody kept it.
        key: of its setup there, "": it has none.
        recordings: its recordings.
    """

    series: str
    name: str
    mode: str
    seed: int | None = None
    table: str = ""
    row: int | None = None
    folder: str = ""
    sources: str = ""
    key: str = ""
    recordings: tuple[str, ...] = ()

    @property
    def title(self) -> str:
        """What people call it."""
        return self.name if self.series == self.name else f"{self.series}/{self.name}"


@dataclass(frozen=True, slots=True)
class PackageContents:
    """A package.

    Attributes:
        version: the vsense that packed it.
        runs: all of it.
        report: names of the tables and recordings that the report is of; (): there is none.
        asked: what was asked of the tables, see `vsense.studies.packages._figures`.
        lacks: what cannot be made again, and why; who packed it says so.
        left_out: what was replaced or left out, and how often.
    """

    version: str
    runs: Sequence[PackedRun]
    report: Sequence[str] = ()
    asked: Mapping[str, Any] = field(default_factory=dict)
    lacks: Sequence[str] = ()
    left_out: Mapping[str, int] = field(default_factory=dict)

    def to_bytes(self) -> bytes:
        """As the package has it; UsageError if nobody could read so much."""
        data = f"{json.dumps({'format': PACKAGE_FORMAT, **asdict(self)}, indent=1)}\n".encode()
        if len(data) > MOST_CONTENTS:
            raise UsageError(
                f"{len(self.runs)} runs are too many for one package: its contents have"
                f" {len(data) >> 10} kB, expected at most {MOST_CONTENTS >> 10}"
            )
        return data

    @classmethod
    def read(cls, data: bytes, names: Sequence[str]) -> PackageContents:
        """Reads what `to_bytes` gave.

        Args:
            names: the files of the package.

        Raises:
            VsenseError: it is something else, or names what is not there.
        """
        try:
            data_ = parse_json(data.decode())
            if data_.pop("format") != PACKAGE_FORMAT:
                raise ValueError(f"another format than {PACKAGE_FORMAT}: another vsense made it")
            runs = [
                PackedRun(**{**run, "recordings": tuple(run["recordings"])})
                for run in data_.pop("runs")
            ]
            contents = cls(runs=runs, **data_)
            _check(contents, set(names))
        except KeyError as error:
            raise VsenseError(f"{CONTENTS} is damaged: it has no {error}") from None
        except (ValueError, TypeError, AttributeError) as error:
            raise VsenseError(f"{CONTENTS} is damaged: {error}") from None
        return contents


def _check(contents: PackageContents, names: set[str]) -> None:
    """Raises ValueError or TypeError where something is not what it is said to be."""
    for run in contents.runs:
        texts = (run.series, run.name, run.mode, run.table, run.folder, run.sources, run.key)
        if not all(isinstance(text, str) for text in (*texts, *run.recordings)):
            raise TypeError("a run whose names are no texts")
        if run.mode not in MODES:
            raise ValueError(f"mode is {run.mode!r}")
        for number in (run.seed, run.row):
            if number is not None and (type(number) is not int or number < 0):
                raise TypeError(f"a run's number is {number!r}")
        _check_files([*filter(None, [run.table]), *run.recordings], names)
        for folder in filter(None, (run.folder, run.sources)):
            if wrong_name(folder):
                raise ValueError(f"{folder!r} is no folder")
    if len(set(contents.runs)) < len(contents.runs):
        raise ValueError("it has a run twice")
    _check_files(contents.report, names)
    if not isinstance(contents.asked, dict) or not isinstance(contents.version, str):
        raise TypeError("its members are of another kind")


def _check_files(wanted: Sequence[str], names: set[str]) -> None:
    missing = [name for name in wanted if not isinstance(name, str) or name not in names]
    if missing:
        raise ValueError(f"{str(missing[0])[:200]!r} is not in the package")
