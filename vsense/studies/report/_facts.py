"""What does not change during a recording, from its `/experiment`; every field may be missing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from vsense.monitor.recording import calibration_words
from vsense.monitor.recording.form import ExperimentMessage
from vsense.world.entities import Arena
from vsense.world.robot_models import EPUCK

TIMESTEP_S = 0.1
"""Where a recording does not say how long a timestep is."""
TIMESTEPS_S = 1e-3, 60.0
"""Shortest and longest timestep."""
NUMBER_MAX = 1e15
"""Greater numbers are damage."""
MOST_M = 1e4
"""Greatest distance of a place, either way."""
MIN_SIDE_M = 0.1
"""Smallest side of an arena."""
MOST_ASPECT = 4.0
"""An arena that is longer than so many of its widths is not drawn as it is."""


SIMULATION, RECORDED = "simulation", "recorded pictures"
RUN_KINDS = {"sim": SIMULATION, "lab": "lab", "run": "robots"}
"""Kinds of runs, by the command that made them, in the order in which they are shown. `RECORDED`: a
run whose cameras are recordings."""


@dataclass(frozen=True, slots=True)
class Facts:
    """What was run; "" and None are unknown, and so are `robots` if they are empty.

    `robots` and `objects` are names by tag, `controllers` ids of what drives robots, where there
    are several; `length_s` None may also be a run without end; `calibration` says how true the
    cameras' is.
    """

    name: str
    seed: int | None
    blind: bool | None
    command: str
    recorded: bool
    timestep_s: float
    length_s: float | None
    arena: Arena | None
    robots: Mapping[int, str]
    objects: Mapping[int, str]
    controllers: Mapping[int, str]
    body_radius_m: float
    radii_m: Mapping[int, float]
    file_text: str
    calibration: str

    @property
    def kind(self) -> str:
        """What kind of run it was, in words; "" unknown."""
        return RECORDED if self.recorded else RUN_KINDS.get(self.command, "")

    @property
    def simulated(self) -> bool:
        """Whether nothing in it was measured of cameras and links."""
        return self.command == "sim"

    def radius_m(self, tag: int) -> float:
        """The radius of a body."""
        return self.radii_m.get(tag, self.body_radius_m)

    def is_robot(self, tag: int) -> bool:
        """Whether a tag is that of a robot that takes part."""
        return tag in self.robots if self.robots else tag not in self.objects


def read_facts(data: Mapping[str, Any]) -> Facts:
    """Reads the data of `/experiment`; what is missing or damaged stays unknown."""
    experiment = ExperimentMessage.read(data)
    timestep_s = number(experiment.timestep_s)
    radius_m = _radius_m(experiment.body_radius_m, EPUCK.radius_m)
    length_s = number(experiment.length_s)
    if timestep_s is None or not TIMESTEPS_S[0] <= timestep_s <= TIMESTEPS_S[1]:
        timestep_s = TIMESTEP_S
    return Facts(
        name=experiment.name,
        seed=experiment.seed,
        blind=experiment.blind,
        command=experiment.command,
        recorded=experiment.recorded,
        timestep_s=timestep_s,
        length_s=length_s if length_s is not None and length_s > 0.0 else None,
        arena=None if experiment.arena is None else _arena(experiment.arena),
        robots=_names(experiment.robots),
        objects=_names(experiment.objects),
        controllers=_controllers(experiment),
        body_radius_m=radius_m,
        radii_m={
            row["tag"]: _radius_m(row.get("radius_m"), radius_m)
            for row in (*experiment.robots, *experiment.objects)
            if isinstance(row.get("tag"), int)
        },
        file_text=experiment.file_text,
        calibration=calibration_words(experiment.calibration or {}),
    )


def _radius_m(value: Any, usual_m: float) -> float:
    radius_m = number(value)
    return radius_m if radius_m is not None and 0.0 < radius_m < 1.0 else usual_m


def number(value: Any) -> float | None:
    """A number of at most `NUMBER_MAX`, or None."""
    if isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) <= NUMBER_MAX:
        return float(value)
    return None


def clock_ns(value: Any) -> int:
    """A time of the host's clock [ns]; ValueError if it is none."""
    if not isinstance(value, int) or abs(value) >= 1 << 62:
        raise ValueError("expected nanoseconds")
    return value


def entities(world: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """The entities of a `/world`."""
    rows = world.get("entities")
    return [row for row in rows if isinstance(row, dict)] if isinstance(rows, list) else []


def numbers(values: Any, count: int) -> tuple[float, ...] | None:
    """So many finite numbers, or None."""
    if not isinstance(values, Sequence) or isinstance(values, str) or len(values) < count:
        return None
    parsed = [number(value) for value in values[:count]]
    return None if None in parsed else tuple(value for value in parsed if value is not None)


def _names(rows: Sequence[Any]) -> dict[int, str]:
    fits = (r for r in rows if isinstance(r, dict) and isinstance(r.get("tag"), int))
    return {row["tag"]: str(row.get("name") or row["tag"]) for row in fits}


def _controllers(experiment: ExperimentMessage) -> dict[int, str]:
    if len(experiment.controllers) < 2:
        return {}
    return {
        tag: str(experiment.controllers[n].get("id"))
        for tag, n in experiment.controller_of().items()
    }


def _arena(data: Mapping[str, Any]) -> Arena | None:
    """The arena, if it can be drawn as it is."""
    size_m, centre_m = numbers(data.get("size_m"), 2), numbers(data.get("centre_m"), 2)
    if size_m is None or centre_m is None or not MIN_SIDE_M <= min(size_m) <= max(size_m) < MOST_M:
        return None
    if max(map(abs, centre_m)) > MOST_M or max(size_m) > MOST_ASPECT * min(size_m):
        return None
    return Arena((size_m[0], size_m[1], 0.0), (centre_m[0], centre_m[1], 0.0))
