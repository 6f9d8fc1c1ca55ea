"""What a benchmark is: files that do not change any more, and what is measured with them.

`config/missions/v1/definition.json` names the missions, their measures and the digest of every
other file: plans, experiments, loop functions, controllers. The digest of that one file is the
definition's: whoever has the same, had the same missions.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from vsense.base.errors import VsenseError
from vsense.base.files import PACKAGE_FOLDER, parse_json, read_text
from vsense.modes.sim.fingerprint import of_file

DEFINITION_FILE = "definition.json"
FULL_PLAN, QUICK = "plan.toml", "quick.toml"
NEWEST = PACKAGE_FOLDER / "config" / "missions" / "v1"
LATER = {
    "aggregation.c": ("cd672e2d5343904624fabfbf85957d39b655b23e986e6fd3bab3f3102f501a3d",),
    "foraging.c": ("f3442bd1832da4f5b94c337dfaba075bd468c69af87d7846686f31c46eb02f42",),
    "phototaxis.c": ("eafa558563d8d545954fb59442bdda412421f951b0959c21964d24987eeba1de",),
}
"""Digests of later states of a definition's files, with which its missions are the same in every
bit: these controllers refuse values of parameters that no mission has."""
BLIND = " blind"
"""What a mission's control condition is called after the mission."""


class OtherDefinition(VsenseError):
    """Files are not those of the definition; the message names them."""


@dataclass(frozen=True, slots=True)
class Mission:
    """One of the missions.

    Attributes:
        name: of its condition in the plan; with `BLIND` after it, of its control.
        measure: the score of a run.
        unit: the measure's.
        better: "more" or "less".
        margin: two labs whose means differ by less are called the same, in the measure's unit.
    """

    name: str
    measure: str
    unit: str
    better: str
    margin: float


@dataclass(frozen=True, slots=True)
class Definition:
    """A version of the benchmark.

    Attributes:
        folder: where its files are.
        name: as results have it.
        robots: so many play in each mission.
        digests: SHA-256 of each file, by its name.
        sha256: of the definition.
    """

    folder: Path
    name: str
    robots: int
    missions: tuple[Mission, ...]
    digests: Mapping[str, str] = field(default_factory=dict)
    sha256: str = ""

    def plan(self, quick: bool = False) -> Path:
        """The plan of its runs, or of a first look."""
        return self.folder / (QUICK if quick else FULL_PLAN)

    @property
    def file(self) -> Path:
        """The one whose digest is the definition's."""
        return self.folder / DEFINITION_FILE

    @property
    def measures(self) -> dict[str, Mission]:
        """The missions by their measures."""
        return {mission.measure: mission for mission in self.missions}

    def has(self, name: str, sha256: str) -> bool:
        """Whether that is its file of the name, or a later state in which missions are the same."""
        known = self.sha256 if name == DEFINITION_FILE else self.digests.get(name)
        return sha256 in (known, *LATER.get(name, ()))

    def require(self, files: Iterable[Path]) -> None:
        """Raises OtherDefinition unless these are the definition's files, all of them."""
        digests = {path.name: of_file(path) for path in (*files, self.plan(), self.plan(True))}
        names = sorted({*digests, *self.digests})
        wrong = [name for name in names if not self.has(name, digests.get(name, ""))]
        if wrong:
            raise OtherDefinition(
                f"{self.name}: not the definition's: {', '.join(wrong)}; results with them would"
                " be comparable with nobody's. Install vsense again"
            )


def load(folder: Path = NEWEST) -> Definition:
    """Reads a definition; VsenseError if it cannot be read."""
    path = folder / DEFINITION_FILE
    sha256 = of_file(path)
    try:
        data: Any = parse_json(read_text(path))
        missions = tuple(Mission(**mission) for mission in data["missions"])
        return Definition(folder, data["name"], data["robots"], missions, data["files"], sha256)
    except (ValueError, KeyError, TypeError) as error:
        raise VsenseError(f"{path}: is no definition of a benchmark: {error!r}") from None
