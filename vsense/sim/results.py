"""The file of a campaign: one row per run; it never mixes two campaigns."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from vsense.errors import UsageError, VsenseError
from vsense.files import read_bytes

_MOST_BYTES = 4 << 30

CAMPAIGN, EXPERIMENT, SEED = "campaign", "experiment", "seed"
ROBOTS, DURATION = "robots", "duration_s"

Key = tuple[str, ...]
"""Identifies a run of a campaign: the settings' values, in the file's order, and the seed."""


class CampaignResults:
    """A CSV file with a line of names.

    Its columns are `campaign`, a fingerprint of all that the runs have in common; `experiment`; one
    column per setting; `seed`; `robots`; `duration_s`; then the measures. Rows come in the order in
    which they are appended and are on the disk when `append` returns.

    Attributes:
        rows: all rows, by column.
        repaired: whether the file ended in half a row, which was cut off.
    """

    def __init__(self, path: Path, campaign: str, settings: Sequence[str]) -> None:
        """Reads the file if there is one; `campaign` is the fingerprint of what is run.

        Raises:
            UsageError: the file holds something else.
            VsenseError: it cannot be read.
        """
        self.path = path
        self._campaign = campaign
        self._fixed = [CAMPAIGN, EXPERIMENT, *settings, SEED, ROBOTS, DURATION]
        self._settings = list(settings)
        self._columns: list[str] | None = None
        self.rows: list[dict[str, str]] = []
        self.repaired = False
        text = self._read()
        if text:
            self._take(text)

    def keys(self) -> set[Key]:
        """The runs that the file holds."""
        return {self.key(row, row[SEED]) for row in self.rows}

    def key(self, settings: Mapping[str, str], seed: object) -> Key:
        return (*(settings[name] for name in self._settings), str(seed))

    @property
    def measures(self) -> list[str]:
        """Names of the measures; none before the first row."""
        return (self._columns or self._fixed)[len(self._fixed) :]

    def append(self, fixed: Mapping[str, object], measures: Mapping[str, float | None]) -> None:
        """Adds a row; `fixed` are the values of all columns before the measures but `campaign`.

        A measure that is None was not taken in this run.

        Raises:
            VsenseError: the measures are not those of the file, or it cannot be written.
        """
        begins = self._columns is None
        self._columns = self._columns or [*self._fixed, *measures]
        if list(measures) != self.measures:
            raise VsenseError(
                f"{self.path}: seed {fixed[SEED]} gave the measures"
                f" {', '.join(measures) or 'none'}; the rows before have"
                f" {', '.join(self.measures) or 'none'}"
            )
        row = {CAMPAIGN: self._campaign} | {name: str(fixed[name]) for name in self._fixed[1:]}
        row |= {name: "" if value is None else f"{value:.12g}" for name, value in measures.items()}
        text = io.StringIO()
        table = csv.DictWriter(text, self._columns, lineterminator="\n")
        if begins:
            table.writeheader()
        table.writerow(row)
        self._write(text.getvalue())
        self.rows.append(row)

    def _read(self) -> str:
        """Reads the whole rows of the file; cuts off half a row at its end."""
        try:
            data = read_bytes(self.path, _MOST_BYTES)
            whole = data[: data.rfind(b"\n") + 1]
            if len(whole) < len(data):
                os.truncate(self.path, len(whole))
                self.repaired = True
            return whole.decode()
        except FileNotFoundError:
            return ""
        except OSError as error:
            raise VsenseError(f"{self.path}: cannot be read: {error.strerror}") from None
        except UnicodeDecodeError:
            raise UsageError(f"{self.path}: is no CSV file of a campaign") from None

    def _take(self, text: str) -> None:
        """Takes the rows, if they are this campaign's."""
        lines = csv.reader(io.StringIO(text, newline=""))
        columns = next(lines)
        if columns[: len(self._fixed)] != self._fixed:
            raise UsageError(
                f"{self.path}:1: the columns {','.join(columns)} are another campaign's; this"
                f" one's begin with {','.join(self._fixed)}; give another file with -o"
            )
        for cells in lines:
            if len(cells) != len(columns):
                raise UsageError(
                    f"{self.path}:{lines.line_num}: {len(cells)} values, expected {len(columns)}"
                )
            row = dict(zip(columns, cells))
            if row[CAMPAIGN] != self._campaign:
                raise UsageError(
                    f"{self.path}:{lines.line_num}: a row of campaign {row[CAMPAIGN]}, this is"
                    f" {self._campaign}: the experiment, its controller or the options have"
                    " changed; give another file with -o"
                )
            self.rows.append(row)
        self._columns = columns

    def _write(self, text: str) -> None:
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with open(self.path, "a", newline="", encoding="utf-8") as file:
                file.write(text)
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise VsenseError(f"{self.path}: cannot be written: {error.strerror}") from None
