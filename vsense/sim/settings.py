"""What a campaign goes through: every combination of its settings, with every seed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

from vsense.errors import UsageError


@dataclass(frozen=True, slots=True)
class Sweep:
    """The settings and seeds of a campaign.

    Attributes:
        values: by setting its values, in the order of the command line.
        seeds: seeds of the runs of every combination; None: there is no campaign, but one run.
    """

    values: dict[str, tuple[str, ...]]
    seeds: tuple[int, ...] | None

    @classmethod
    def of(
        cls, settings: Sequence[tuple[str, str]], runs: int | None, seeds: Sequence[int] | None
    ) -> Sweep:
        """Reads the command line.

        Args:
            settings: setting and its values, separated by commas, or by semicolons where one
                holds a comma.
            runs: runs of every combination, None: not said.
            seeds: their seeds, None: not said.

        Raises:
            UsageError: a setting or a value is there twice, a value is empty, or there are not
                as many seeds as runs.
        """
        values: dict[str, tuple[str, ...]] = {}
        for key, text in settings:
            if key in values:
                raise UsageError(f"--set {key}: given twice; give all values in one")
            values[key] = _split(key, text)
        if runs is not None and seeds is not None and len(seeds) != runs:
            raise UsageError(f"--runs {runs}: --seeds names {len(seeds)}")
        if runs is None and seeds is None and all(len(some) == 1 for some in values.values()):
            return cls(values, None)
        return cls(values, tuple(seeds) if seeds is not None else tuple(range(1, (runs or 1) + 1)))

    @property
    def keys(self) -> tuple[str, ...]:
        """The settings' names."""
        return tuple(self.values)

    @property
    def first(self) -> dict[str, str]:
        """The first combination."""
        return {key: some[0] for key, some in self.values.items()}

    def combinations(self) -> Iterator[dict[str, str]]:
        """All combinations; the last setting changes fastest."""
        for some in product(*self.values.values()):
            yield dict(zip(self.values, some))


def _split(key: str, text: str) -> tuple[str, ...]:
    parts = text.removesuffix(";").split(";") if ";" in text else text.split(",")
    values = tuple(part.strip() for part in parts)
    if "" in values:
        raise UsageError(f"--set {key}={text}: expected values between the separators")
    if len(set(values)) < len(values):
        raise UsageError(f"--set {key}={text}: expected every value once")
    return values
