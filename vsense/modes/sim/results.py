"""The table of a campaign: a runs.csv with a row for each run; it never mixes two campaigns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from vsense.base.errors import UsageError, VsenseError
from vsense.modes.sim.job import Setup
from vsense.run.runs_csv import RunRow, RunsFile, condition_of, versions

Key = tuple[str, int | None]
"""Identifies a run of a campaign: its condition, and the seed."""


class CampaignResults:
    """A runs.csv of one campaign, whose fingerprint is its `series`.

    Rows come in the order in which they are appended and are on the disk when `append` returns. A
    simulation has no time of day: the same campaign gives the same bytes.

    Attributes:
        repaired: whether the file ended in half a row, which was cut off.
    """

    def __init__(self, path: Path, campaign: str) -> None:
        """Reads the file if there is one; `campaign` is the fingerprint of what is run.

        Raises:
            UsageError: the file holds something else.
            VsenseError: it cannot be read.
        """
        self.path = path
        self._campaign = campaign
        self._file = RunsFile(path)
        self.repaired = self._file.repaired
        for line, row in enumerate(self.rows, 2):
            if row.series != campaign:
                raise UsageError(
                    f"{path}:{line}: a row of campaign {row.series or 'without a name'}, this is"
                    f" {campaign}: the experiment, its controller, the options or the names of"
                    " settings have changed; give another file with -o"
                )

    @property
    def rows(self) -> Sequence[RunRow]:
        """All rows."""
        return self._file.rows

    @property
    def measures(self) -> Sequence[str]:
        """Names of the measures; none before the first row."""
        return self._file.measures

    def keys(self) -> set[Key]:
        """The runs that the file holds."""
        return {(row.condition, row.seed) for row in self.rows}

    def append(
        self, setup: Setup, seed: int, result: Mapping[str, Any], measures: Mapping[str, Any]
    ) -> None:
        """Adds a row.

        Args:
            setup, seed: what was run.
            result: `name`, `duration_s` and `tags` of the run.
            measures: its last values by name; one that is None was not taken.

        Raises:
            VsenseError: the measures are not those of the file, or it cannot be written.
        """
        if self.rows and list(measures) != list(self.measures):
            raise VsenseError(
                f"{self.path}: seed {seed} gave the measures"
                f" {', '.join(measures) or 'none'}; the rows before have"
                f" {', '.join(self.measures) or 'none'}"
            )
        condition = condition_of(setup.blind, setup.settings)
        self._file.append(
            RunRow(
                run=f"{condition}, seed {seed}",
                series=self._campaign,
                mode="sim",
                experiment=result["name"],
                condition=condition,
                # Runs of one seed begin alike in every condition.
                start=f"seed{seed}",
                seed=seed,
                duration_s=result["duration_s"],
                robots=len(result["tags"]),
                tags=tuple(result["tags"]),
                versions=versions(),
                measures={name: _kept(value) for name, value in measures.items()},
            )
        )


def _kept(value: float | None) -> float | None:
    """A number as it is read again: it is the same campaign, whether or not it was interrupted."""
    return None if value is None else float(f"{value:.12g}")
