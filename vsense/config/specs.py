"""What an experiment file says, as frozen records: lengths in m, angles in rad, arena frame.

`id` is what the file calls a thing. `line` is that of a record's element, so that a fault which
shows only later (a body that does not fit, a controller that does not build) is still reported at
its place: `Experiment.error(line, message)`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path

from vsense.base.errors import ConfigError
from vsense.config._bodies import ObjectSpec as ObjectSpec
from vsense.config._bodies import Pose as Pose
from vsense.config._bodies import RobotSpec as RobotSpec
from vsense.config._distribute import DistributedSpec
from vsense.config.casting import Casting
from vsense.config.geofence import Geofence, arena_fence
from vsense.config.roster_fields import MarkerOffset
from vsense.robots.link.trackers.mocap import MocapSystem
from vsense.robots.sources import ProgramSources, content
from vsense.world.actuators.base import MountedActuator
from vsense.world.entities import Arena, Box, Cylinder, Entity, VirtualRobot
from vsense.world.physics.motion import WheelNoise
from vsense.world.pollution import PollutantSource
from vsense.world.robot_models import EPUCK, RobotModel
from vsense.world.sensors.base import MountedSensor

ROBOT_ID, SPEED_LIMIT = "vs:id", "vs:v_max"
"""Parameters: a robot's own name, for a controller for ARGoS; its speed limit [m/s]."""


class Stage(Enum):
    """What an experiment is loaded for, which decides what of its file is real."""

    RUN = "run"
    """Real robots: what a body or device is made of, the arena decides."""
    LAB = "lab"
    """Cameras, robots and their daemons in real time; only light and wheels are simulated."""
    SIM = "sim"
    """Everything is simulated, on a virtual clock."""


@dataclass(frozen=True, slots=True)
class DeviceSpec:
    """A device that a controller declares.

    Attributes:
        section: "sensors" or "actuators".
        element: its element's name.
        server: who serves it, in words.
        served: whether somebody does.
    """

    section: str
    element: str
    server: str
    served: bool


@dataclass(frozen=True, slots=True)
class ControllerSpec:
    """What drives some or all of the robots, and what they sense and do virtually.

    Sources, includes and label together say which program it is.

    Attributes:
        label: the name of its element.
        library: a shipped controller's name, or the path of a C source.
        sources: the files that its program is compiled from.
        includes: folders of headers of its own.
        params: the user's own settings, passed on as they are.
        sensors, actuators: the virtual ones.
        configuration: lines that a controller for ARGoS is sent instead of its settings; "": it
            is none.
        devices: all that it declares.
        wheel_noise: of its robots in lab and simulation; None: they obey.
        v_max_m_s: its robots' wheels are no faster; None: as fast as they can.
    """

    id: str
    label: str
    library: str
    sources: tuple[Path, ...]
    includes: tuple[Path, ...]
    params: Mapping[str, str]
    sensors: tuple[MountedSensor, ...]
    actuators: tuple[MountedActuator, ...]
    line: int
    devices: tuple[DeviceSpec, ...] = ()
    wheel_noise: WheelNoise | None = None
    argos_lines: str = ""
    v_max_m_s: float | None = None

    @property
    def program(self) -> ProgramSources:
        """What it is built from."""
        program = ProgramSources(self.sources, self.includes, self.label)
        return program if program.is_argos else ProgramSources(self.sources)

    @property
    def params_text(self) -> str:
        """The settings as robots are sent them: lines "key=value\\n"."""
        return self.argos_lines or "".join(f"{key}={value}\n" for key, value in self.params.items())

    def params_for(self, robot: str) -> str:
        """The settings as the robot of this name is sent them."""
        limit = "" if self.v_max_m_s is None else f"{SPEED_LIMIT}={self.v_max_m_s:.6f}\n"
        return limit + self.params_text + (f"{ROBOT_ID}={robot}\n" if self.argos_lines else "")


@dataclass(frozen=True, slots=True)
class MarkerSpec:
    """The markers on robots and objects: their family, and their height above the floor.

    `line` is the root's where the element is absent; `is_said`: the file says the height, of all.
    """

    family: str
    height_m: float
    line: int
    is_said: bool = False


@dataclass(frozen=True, slots=True)
class FloorSpec:
    """What the floor looks like.

    Attributes:
        source: "image" or "loop_functions".
        path: the image's file; None with source "loop_functions".
        pixels_per_m: resolution at which loop functions are asked for colours; 0 with an image.
    """

    id: str
    source: str
    path: Path | None
    pixels_per_m: float
    line: int


@dataclass(frozen=True, slots=True)
class FieldSpec:
    """A quantity that is spread over the floor, such as a pheromone.

    Attributes:
        cell_m: side of a grid cell.
        evaporation_per_s: share of it that vanishes in a second (rate of the exponential).
        diffusion_m2_s: how fast it spreads.
        initial: its amount everywhere at the start [1/m2].
    """

    id: str
    cell_m: float
    evaporation_per_s: float
    diffusion_m2_s: float
    initial: float
    line: int


@dataclass(frozen=True, slots=True)
class LoopSpec:
    """The user's functions that are called around every timestep.

    Attributes:
        path: their file, of several in C++ the first.
        label: the class in it that holds them, as ARGoS's label names one; "": not said.
        params: the other attributes of `<loop_functions>` and of the elements in it (`child.key`).
        program: what they are built of if they are C++ for ARGoS.
        settings: the element as these read it, see `robot/argos/configuration.hpp`.
    """

    path: Path
    label: str
    params: Mapping[str, str]
    line: int
    program: ProgramSources | None = None
    settings: str = ""

    @property
    def looks_at_leds(self) -> bool:
        """Whether C++ may ask what robots' LEDs show."""
        files = () if self.program is None else self.program.own_files()
        return any(b"LEDEquipped" in content(path) for path in files)


@dataclass(frozen=True, slots=True)
class TrackerAddress:
    """A tracker that speaks the original protocol.

    Attributes:
        host, port: its name or address, and its TCP port.
        origin_m: where the arena's origin lies in the tracker's frame.
        latency_s: from the middle of an exposure to the arrival of its state.
    """

    host: str
    port: int
    origin_m: tuple[float, float]
    latency_s: float
    line: int


DEFAULT_UNSEEN_S = 1.0
"""A robot that no camera has seen for so long stands."""

LINES_PORT = 4041
"""Where trackers that write JSON lines find vsense."""


@dataclass(frozen=True, slots=True)
class JsonLinesTracker:
    """Any other tracker: it connects to vsense and writes JSON lines.

    `host` is the interface on which it is waited for; `port` 0 takes any that is free.
    """

    host: str
    port: int
    line: int


@dataclass(frozen=True, slots=True)
class MocapTracker:
    """A motion capture system."""

    system: MocapSystem
    line: int


AnyTracker = TrackerAddress | JsonLinesTracker | MocapTracker
"""Where an experiment may say that its arena states come from."""


@dataclass(frozen=True, slots=True)
class Experiment:
    """A checked experiment file; all that stands in it is in the file's order.

    Attributes:
        name: the file's name without ending.
        file: the file as errors call it.
        path: where it lies; relative paths in it are taken from its folder.
        length_s: length of the run; 0: no limit. To change it, give it to `load`: the wind's turn
            may be a share of it.
        seed: seed of everything that is drawn; 0: the caller draws one.
        host, port: IPv4 address of the virtual sensor server, in numbers, and its port.
        unseen_s: a robot that no camera has seen for so long stands; None: it drives on.
        objects: tagged things that are no robots.
        sources: what pollutes.
        controllers: those that robots run, at least one.
        warnings: what is passed over: `file:line: what happens instead`.
        entities: what stands in the arena beside robots and tagged objects, virtual robots
            included.
        distributed: entities that a seed places; empty once they are placed, see `settle`.
        floor: what the floor looks like, None: plain white.
        tracker: where the arena state comes from, None: from cameras of our own.
        stage: what it was loaded for.
        markers: by tag, where markers sit on their robots, as far as it was measured.
        casting: who was to play the parts; `taken` are those that were taken out of a roster.
        geofence: the file's own, None: it has none.
    """

    name: str
    file: str
    path: Path
    length_s: float
    ticks_per_second: int
    seed: int
    host: str
    port: int
    arena: Arena
    robots: tuple[RobotSpec, ...]
    objects: tuple[ObjectSpec, ...]
    marker: MarkerSpec
    controllers: tuple[ControllerSpec, ...]
    sources: tuple[PollutantSource, ...] = ()
    warnings: tuple[str, ...] = ()
    entities: tuple[Entity, ...] = ()
    distributed: tuple[DistributedSpec, ...] = ()
    floor: FloorSpec | None = None
    fields: tuple[FieldSpec, ...] = ()
    loop_functions: LoopSpec | None = None
    tracker: AnyTracker | None = None
    stage: Stage = Stage.RUN
    markers: Mapping[int, MarkerOffset] = field(default_factory=dict)
    casting: Casting = Casting()  # noqa: RUF009 (frozen)
    taken: tuple[int, ...] = ()
    unseen_s: float | None = DEFAULT_UNSEEN_S
    geofence: Geofence | None = None

    @property
    def fence(self) -> Geofence:
        """Outside of it robots stand: the file's, or around the arena."""
        return self.geofence or arena_fence(self.arena)

    @property
    def tags(self) -> dict[str, int]:
        """Of all that wears a marker, by id."""
        robots = {robot.id: robot.tag for robot in self.robots}
        return robots | {thing.id: thing.tag for thing in self.objects}

    @property
    def bodies(self) -> tuple[RobotSpec | ObjectSpec, ...]:
        """All that wears a marker: robots, then objects."""
        return (*self.robots, *self.objects)

    @property
    def models(self) -> dict[int, RobotModel]:
        """Of all robots and of all that wears a marker, by tag."""
        return {body.tag: body.model for body in (*self.bodies, *self.virtual_robots)}

    @property
    def tallest_m(self) -> float:
        """What hangs higher stands in nobody's way."""
        return max([EPUCK.height_m, *(body.model.height_m for body in self.bodies)])

    def marker_height_m(self, model: RobotModel) -> float:
        """How high the marker is on a body of this model; a spare is taken for an e-puck."""
        if self.marker.is_said or model == EPUCK:
            return self.marker.height_m
        return model.marker_height_m

    @property
    def boxes(self) -> tuple[Box, ...]:
        """Boxes in the real arena without those that await a place."""
        return tuple(e for e in self.entities if isinstance(e, Box) and e.physical)

    @property
    def cylinders(self) -> tuple[Cylinder, ...]:
        """See `boxes`."""
        return tuple(e for e in self.entities if isinstance(e, Cylinder) and e.physical)

    @property
    def solids(self) -> tuple[Box | Cylinder, ...]:
        """The boxes, then the cylinders."""
        return (*self.boxes, *self.cylinders)

    @property
    def virtual_robots(self) -> tuple[VirtualRobot, ...]:
        return tuple(e for e in self.entities if isinstance(e, VirtualRobot))

    def controller_of(self, robot: RobotSpec | VirtualRobot) -> ControllerSpec:
        """What drives a robot; a virtual one that loop functions move is given the first."""
        controllers = {controller.id: controller for controller in self.controllers}
        return controllers.get(robot.controller, self.controllers[0])

    @property
    def wheel_noises(self) -> list[WheelNoise | None]:
        """That of each robot's simulated wheels."""
        return [self.controller_of(robot).wheel_noise for robot in self.robots]

    def driven_by(self, controller: ControllerSpec) -> tuple[str, ...]:
        """The ids of the robots that a controller drives, virtual ones included."""
        entities = (*self.entities, *(spec.entity for spec in self.distributed))
        virtual = [entity for entity in entities if isinstance(entity, VirtualRobot)]
        real = tuple(robot.id for robot in self.robots if robot.controller == controller.id)
        return (*real, *(robot.id for robot in virtual if robot.controller == controller.id))

    @property
    def timestep_s(self) -> float:
        return 1.0 / self.ticks_per_second

    @property
    def timestep_ns(self) -> int:
        return round(1e9 / self.ticks_per_second)

    @property
    def source(self) -> PollutantSource | None:
        """The pollutant source that a run's figures are about: the file's first, if it has one."""
        return self.sources[0] if self.sources else None

    @property
    def turn_timestep(self) -> int | None:
        """The run's timestep at which that source's wind turns; None: never."""
        return None if self.source is None else self.source.turn_timestep

    @property
    def timesteps(self) -> int:
        """Timesteps of the run; 0: no limit."""
        return round(self.length_s * self.ticks_per_second)

    def refuse_warnings(self) -> None:
        """Raises ConfigError at the first place where something is passed over: `--strict`."""
        if self.warnings:
            place, _, words = self.warnings[0].removeprefix(self.file).partition(": ")
            more = len(self.warnings) - 1
            hint = f", and {more} more like it (--dry shows them)" if more else ""
            raise self.error(int(place[1:]), f"{words} [--strict{hint}]")

    def error(self, line: int, message: str) -> ConfigError:
        """Makes the error that something in the file cannot be done."""
        return ConfigError(self.file, line, message)
