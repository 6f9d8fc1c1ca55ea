"""What `--dry` prints: what an experiment holds, what is not supported, and what it costs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

from vsense.base.native import lib
from vsense.config.specs import AnyTracker, ControllerSpec, Experiment, MocapTracker, Stage
from vsense.vision.markers.families import confusion, load_family
from vsense.world.entities import Box, Cylinder, Entity, Light, VirtualRobot, Zone
from vsense.world.robot_models import EPUCK
from vsense.world.sensors.base import layout_dtype

STATE_BYTES: int = lib.VS_DATAGRAM_MAX - lib.VS_SENSOR_BYTES
"""A datagram to a robot without any sensor: header, wanted state and tail."""
TELEMETRY_BYTES: int = (
    lib.VS_DATAGRAM_MAX - lib.VS_ACTUATOR_BYTES - lib.VS_LOG_MAX - lib.VS_SHOWN_MAX
)
"""A datagram from a robot without any actuator that shows and logs nothing."""
_AGE_BYTES = 4
"""Each sensor's value goes with its age. Source: c_src/PROTOCOL.md, STATE."""

_KINDS: tuple[tuple[str, type[Entity]], ...] = (
    ("boxes", Box),
    ("cylinders", Cylinder),
    ("lights", Light),
    ("zones", Zone),
    ("virtual robots", VirtualRobot),
)


def bytes_down(controller: ControllerSpec) -> int:
    """Counts the bytes of one datagram to a robot, without those of UDP and IP."""
    sizes = [_size(mounted.sensor.layout) for mounted in controller.sensors]
    return STATE_BYTES + sum(_AGE_BYTES + size for size in sizes)


def bytes_up(controller: ControllerSpec) -> int:
    """Counts the bytes of a datagram from a robot that shows and logs nothing, without UDP, IP."""
    return TELEMETRY_BYTES + sum(_size(m.actuator.layout) for m in controller.actuators)


def as_json(experiment: Experiment) -> dict[str, Any]:
    """The same as `describe` for programs: `holds` has pairs of a name and what it holds."""
    return {
        "experiment": experiment.name,
        "file": experiment.file,
        "holds": _rows(experiment),
        "not_supported": experiment.warnings,
    }


def _rows(experiment: Experiment) -> list[tuple[str, str]]:
    rows = [
        *_run_rows(experiment),
        *_body_rows(experiment),
        *_virtual_rows(experiment),
    ]
    for controller in experiment.controllers:
        rows += _controller_rows(controller, experiment)
    return rows


def describe(experiment: Experiment) -> str:
    """Describes an experiment in lines "name   what it holds"."""
    rows = _rows(experiment)
    width = max(len(name) for name, _ in rows)
    lines = [f"{experiment.name} ({experiment.file})"]
    lines += [f"  {name:{width}}  {text}" for name, text in rows]
    if not experiment.warnings:
        return "\n".join([*lines, "everything in the file is supported"])
    return "\n".join([*lines, "not as the file says:", *(f"  {w}" for w in experiment.warnings)])


def _run_rows(experiment: Experiment) -> list[tuple[str, str]]:
    length = f"{experiment.length_s:g} s" if experiment.length_s else "no limit"
    steps = f", {experiment.timesteps} timesteps" if experiment.timesteps else ", timesteps"
    seed = f"seed {experiment.seed}" if experiment.seed else "a fresh seed"
    tracker = experiment.tracker
    place = "" if tracker is None else _place(tracker)
    return [
        ("length", f"{length}{steps} of {1e3 * experiment.timestep_s:g} ms, {seed}"),
        ("server", f"{experiment.host}:{experiment.port}, TCP and UDP"),
        ("arena state", f"from the tracker {place}" if place else "from cameras of our own"),
    ]


def _place(tracker: AnyTracker) -> str:
    if isinstance(tracker, MocapTracker):
        return f"{tracker.system.type} at {tracker.system.settings['hostname']}, motion capture"
    return f"{tracker.host}:{tracker.port}"


def _body_rows(experiment: Experiment) -> list[tuple[str, str]]:
    size = " x ".join(f"{size_m:g}" for size_m in experiment.arena.size_m)
    centre = ",".join(f"{centre_m:g}" for centre_m in experiment.arena.centre_m)
    marker = experiment.marker
    rows = [
        ("arena", f"{size} m around {centre}"),
        ("markers", f"{marker.family}, {marker.height_m:g} m above the floor"),
        ("robots", _tagged([(robot.id, robot.tag) for robot in experiment.robots])),
    ]
    rows += [("model", words) for words in _models(experiment)]
    if experiment.objects:
        rows.append(("objects", _tagged([(thing.id, thing.tag) for thing in experiment.objects])))
    if words := tag_confusion(experiment):
        rows.append(("tags", words))
    for name, kind in _KINDS:
        placed = [e for e in experiment.entities if isinstance(e, kind)]
        drawn = [s.entity for s in experiment.distributed if isinstance(s.entity, kind)]
        if placed or drawn:
            rows.append((name, _counted([*placed, *drawn], len(drawn), kind)))
    return rows


def _models(experiment: Experiment) -> list[str]:
    """The models of an experiment in which not all robots are e-pucks."""
    counts = Counter(robot.model for robot in experiment.robots)
    if set(counts) == {EPUCK}:
        return []
    lines = []
    for model, count in counts.items():
        marker_m = experiment.marker_height_m(model)
        size = f"radius {model.radius_m:.3g} m, marker at {marker_m:g} m"
        lines.append(f"{model.name}: {count} robots, {size}, {model.v_max_m_s:.3g} m/s at most")
    return lines


def tag_confusion(experiment: Experiment) -> str:
    """Which tags cameras may confuse, in words; "": none, or there are no cameras."""
    if experiment.stage is Stage.SIM:
        return ""
    return confusion(load_family(experiment.marker.family), experiment.tags.values())


def _counted(entities: Sequence[Entity], drawn: int, kind: type[Entity]) -> str:
    text = f"{len(entities)}"
    if kind in (Box, Cylinder):
        physical = sum(getattr(e, "physical", False) for e in entities)
        text += f" ({physical} physical, {len(entities) - physical} virtual)"
    if drawn:
        text += f", {drawn} of them placed by the seed"
    return f"{text}: {', '.join(entity.id for entity in entities)}"


def _tagged(bodies: Sequence[tuple[str, int]]) -> str:
    return f"{len(bodies)}: " + ", ".join(f"{name} (tag {tag})" for name, tag in bodies)


def _virtual_rows(experiment: Experiment) -> list[tuple[str, str]]:
    rows = []
    floor = experiment.floor
    if floor is not None:
        said = floor.path if floor.path is not None else "as the loop functions paint it"
        rows.append(("floor", f"{floor.id}: {said}"))
    rows += [
        (
            "field",
            f"{spec.id}: cells of {spec.cell_m:g} m, evaporation {spec.evaporation_per_s:g} 1/s,"
            f" diffusion {spec.diffusion_m2_s:g} m^2/s, at first {spec.initial:g} 1/m^2",
        )
        for spec in experiment.fields
    ]
    if experiment.loop_functions is not None:
        rows.append(("loop functions", str(experiment.loop_functions.path)))
    return rows


def _controller_rows(controller: ControllerSpec, experiment: Experiment) -> list[tuple[str, str]]:
    """A controller with its devices; which robots it drives, where it is not the only one."""
    params = ", ".join(f"{key}={value}" for key, value in controller.params.items())
    rows = [("controller", f"{controller.id}: {controller.library}")]
    if len(experiment.controllers) > 1:
        rows.append(("drives", ", ".join(experiment.driven_by(controller))))
    rows += [("parameters", params)] if params else []
    rows += [
        ("sensor", f"{m.sensor.name}: {m.sensor.layout}, {_size(m.sensor.layout)} bytes")
        for m in controller.sensors
    ]
    rows += [
        ("actuator", f"{m.actuator.name}: {m.actuator.layout}, {_size(m.actuator.layout)} bytes")
        for m in controller.actuators
    ]
    rows += [
        (spec.section.removesuffix("s"), f"<{spec.element}>: {spec.server}")
        for spec in controller.devices
    ]
    traffic = (
        f"per robot and timestep {bytes_down(controller)} bytes down, {bytes_up(controller)}"
        " bytes up: one datagram each, UDP and IP not counted; with a timestep of more than"
        " 50 ms it is repeated every 50 ms"
    )
    return [*rows, ("traffic", traffic)]


def _size(layout: str) -> int:
    count, dtype = layout_dtype(layout)
    return count * dtype.itemsize
