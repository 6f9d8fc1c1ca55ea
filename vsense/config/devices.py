"""Reads `<sensors>` and `<actuators>` of a controller: who serves each device that it declares.

Every module in `vsense/world/sensors/` and `vsense/world/actuators/` that names XML elements is a
virtual
device: it holds `ELEMENTS`, the names, and `from_xml(element, scope)`. Where elements of ARGoS ask
for the same device it holds their names, too, as `ARGOS_ELEMENTS`, with `from_argos(element,
scope)`, and in `ARGOS_NOISE` which noise of `vsense.world.sensors.quality` they have.

Such an element is a virtual device under the robot's own name in the lab and in simulation, and
with real robots where `vs:virtual="true"` or the command line says so. Otherwise the robot's own
is used, as its ring of proximity sensors is in the lab.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from types import ModuleType
from typing import Any

import vsense.world.actuators
import vsense.world.sensors
from vsense.base.native import WireError
from vsense.base.xml.element import Element
from vsense.config import argos
from vsense.config._things import Media, check_medium
from vsense.config.specs import DeviceSpec, Stage
from vsense.robots.link.table import Direction, Entry, Table
from vsense.world.actuators.base import ActuatorError, MountedActuator, VirtualActuator
from vsense.world.actuators.leds import lamps_of
from vsense.world.entities import Light
from vsense.world.physics.motion import WheelNoise, Wheels
from vsense.world.robot_models import RobotModel
from vsense.world.sensors.base import (
    MountedSensor,
    RobotSettings,
    Scope,
    SensorError,
    VirtualSensor,
    layout_dtype,
    scale_of,
)
from vsense.world.sensors.quality import NOISES, Quality, updating_from_xml

SENSORS = "sensors"
ACTUATORS = "actuators"

_KINDS = {
    SENSORS: (vsense.world.sensors, SensorError),
    ACTUATORS: (vsense.world.actuators, ActuatorError),
}
_WAYS = {SENSORS: Direction.SENSOR, ACTUATORS: Direction.ACTUATOR}

Factory = Callable[[Element, Scope], Any]
"""Makes a `VirtualSensor` or a `VirtualActuator`."""


@cache
def factories(section: str) -> dict[str, Factory]:
    """Gives what makes a virtual device of a section, by the name of its XML element.

    Raises:
        SensorError, ActuatorError: two modules claim the same element.
    """
    factories: dict[str, Factory] = {}
    for name, module in _claims(section, "ELEMENTS"):
        if name in factories:
            raise _KINDS[section][1](f"{module.__name__}: <{name}> is another module's")
        factories[name] = module.from_xml
    return factories


@cache
def of_argos(section: str) -> dict[str, ModuleType]:
    """Gives the modules that serve ARGoS's devices of a section, by the name of its element."""
    return dict(_claims(section, "ARGOS_ELEMENTS"))


def _claims(section: str, attribute: str) -> Iterator[tuple[str, ModuleType]]:
    package, _ = _KINDS[section]
    for module_info in pkgutil.iter_modules(package.__path__):
        module = importlib.import_module(f"{package.__name__}.{module_info.name}")
        for name in getattr(module, attribute, ()):
            yield name, module


def virtual_devices() -> dict[str, Collection[str]]:
    """Gives the elements of all virtual devices, by the element that holds them."""
    return {section: factories(section).keys() for section in _KINDS}


def mount_sensor(element: Element, scope: Scope) -> MountedSensor:
    """Makes the sensor that an element of `factories(SENSORS)` asks for."""
    element.choice("implementation", ("default",), "default")
    return _mounted_sensor(element, factories(SENSORS)[element.name](element, scope), NOISES)


def mount_actuator(element: Element, scope: Scope) -> MountedActuator:
    """Makes an actuator; the sensors have added their pollutant sources to `scope`."""
    element.choice("implementation", ("default",), "default")
    actuator = factories(ACTUATORS)[element.name](element, scope)
    return MountedActuator(actuator, element.line, Quality.from_xml(element, actuator.scale))


def _mounted_sensor(
    element: Element, sensor: VirtualSensor, noises: Collection[str]
) -> MountedSensor:
    try:
        layout_dtype(sensor.layout)
    except SensorError as error:
        raise element.error(str(error)) from None
    quality = Quality.from_xml(element, scale_of(sensor), noises)
    condition, every = updating_from_xml(element, sensor, quality.update_every)
    return MountedSensor(sensor, element.line, replace(quality, update_every=every), condition)


_MAX_WHEEL_NOISE = 1e3

_Entries = dict[str, tuple[Entry, int]]
"""Rows of a sensor table and their lines, by name."""


@dataclass(slots=True)
class Devices:
    """What a controller declares, while it is read.

    Attributes:
        sensors, actuators: the virtual ones.
        declared: all, and who serves them.
        cpp: the controller is C++ for ARGoS.
        robots: settings of the robots that it drives.
        wheel_noise: of simulated wheels, None: none.
    """

    controller: Element
    cpp: bool
    robots: RobotSettings
    sensors: list[MountedSensor] = field(default_factory=list)
    actuators: list[MountedActuator] = field(default_factory=list)
    declared: list[DeviceSpec] = field(default_factory=list)
    entries: _Entries = field(default_factory=dict)
    wheel_noise: WheelNoise | None = None

    def section(self, kind: str) -> list[Element]:
        """The devices of a kind in the file's order; known are asked for, which others are not."""
        section = self.controller.optional_child(kind)
        if section is None:
            return []
        section.children(*_element_names(kind))
        if not section.document.lenient:
            for name in (*of_argos(kind), *argos.OWN_DEVICES[kind]):
                section.optional_child(name)
        return section.below()


def _element_names(kind: str) -> set[str]:
    own, missing = argos.OWN_DEVICES[kind], argos.MISSING[kind]
    return {*factories(kind), *of_argos(kind), *own, *missing}


@dataclass(frozen=True, slots=True)
class DeviceRule:
    """What the devices of ARGoS are where an experiment is loaded for a stage.

    With `virtual` they are virtual where nothing else is said; `seen`: cameras of robots, or loop
    functions, look at LEDs.
    """

    stage: Stage
    virtual: bool
    seen: bool

    def is_virtual(self, element: Element, cpp: bool, has_ring: bool) -> bool:
        """Whether an element of ARGoS is a virtual device; `has_ring`: the robots have one of their
        own."""
        if element.has("vs:virtual"):
            return element.boolean("vs:virtual")
        if element.name in argos.PROXIMITY_SENSORS and has_ring:
            noisy = any(element.peek(noise) is not None for noise in NOISES)
            return self.stage is Stage.SIM and (cpp or noisy)
        if element.name in argos.BATTERIES:
            return self.stage is Stage.SIM
        return self.virtual and (self.seen or element.name not in argos.LAMPS)


def read_devices(
    controllers: Sequence[Element],
    scope: Scope,
    media: Media,
    settings: Sequence[RobotSettings],
    stage: Stage,
    virtual: bool,
    cpp: Sequence[bool],
) -> list[Devices]:
    """Mounts the virtual sensors and actuators that each controller asks for.

    They may refer to `scope`, to which sensors add their sources, and to `media`. Those of one
    controller must have different names, and a datagram must hold them all. `settings` are those
    of the robots of each controller; `virtual` as in `DeviceRule`; `cpp`: it is C++ for ARGoS.
    """
    names = {e.name for c in controllers for s in c.below(SENSORS) for e in s.below()}
    seen = scope.watched or any(camera in names for camera in argos.CAMERA_SENSORS)
    rule = DeviceRule(stage, virtual, seen)
    scope.leds = _leds(controllers, scope, [robots.model for robots in settings])
    mounted = [
        Devices(controller, is_cpp, robots)
        for controller, is_cpp, robots in zip(controllers, cpp, settings)
    ]
    # Actuators may act on what another controller's sensors have added to the world.
    for kind in _KINDS:
        for devices in mounted:
            scope.robots = devices.robots
            argos.share_room([element.name for element in devices.section(kind)], scope)
            _read_section(devices, kind, scope, media, rule)
    return mounted


def _leds(controllers: Sequence[Element], scope: Scope, models: Sequence[RobotModel]) -> int:
    """Counts the LEDs of others that a robot may see."""
    actuators = {e.name for c in controllers for s in c.below(ACTUATORS) for e in s.below()}
    lamps = [name for name in argos.LAMPS if name in actuators]
    counts = [sum(lamps_of(name, model)[2] for name in lamps) for model in models]
    per_robot = max((min(n, len(m.lamps_m)) for n, m in zip(counts, models)), default=0)
    things = sum(len(getattr(thing, "leds", ())) for thing in scope.entities.values())
    low_m = 2.0 * max((model.camera.height_m for model in models), default=0.0)
    lights = [
        e for e in scope.entities.values() if isinstance(e, Light) and e.position_m[2] < low_m
    ]
    return per_robot * (scope.most - 1) + things + len(lights)


def _read_section(
    devices: Devices, kind: str, scope: Scope, media: Media, rule: DeviceRule
) -> None:
    """Reads the devices of a kind: explicit virtual ones first, their names are theirs."""
    elements = devices.section(kind)
    for element in elements:
        if element.name in factories(kind):
            argos.pass_over(element, argos.ORIGINAL_SETTINGS)
            check_medium(element, media, element.name == argos.HEARING)
            mounted = (mount_sensor if kind == SENSORS else mount_actuator)(element, scope)
            _add(devices, kind, element, mounted)
    for element in elements:
        if element.name in factories(kind):
            continue
        if element.name in argos.MISSING[kind]:
            element.leave_out(argos.MISSING[kind][element.name])
            devices.declared.append(_nobodys(element, kind))
        elif element.name not in _element_names(kind):
            devices.declared.append(_nobodys(element, kind))
        else:
            _read_argos(devices, kind, element, scope, media, rule)


def _nobodys(element: Element, kind: str) -> DeviceSpec:
    return DeviceSpec(kind, element.name, "nothing serves it", False)


def _read_argos(
    devices: Devices, kind: str, element: Element, scope: Scope, media: Media, rule: DeviceRule
) -> None:
    """Mounts a device of ARGoS, or leaves it to the robot."""
    element.choice("implementation", argos.IMPLEMENTATIONS, "default")
    has_ring = bool(devices.robots.model.ring.places_m)
    if element.name in of_argos(kind) and rule.is_virtual(element, devices.cpp, has_ring):
        check_medium(element, media, kind == SENSORS and element.name in argos.ARGOS_HEARING)
        mounted = _mount_argos(element, kind, scope)
        name = _device(mounted).name
        if name not in devices.entries:
            _add(devices, kind, element, mounted)
            _pass_over_unread(element)
            return
        line = devices.entries[name][1]
        element.leave_out(f"line {line} serves {name!r} already")
        served = f"what line {line} mounts as {name!r}"
        devices.declared.append(DeviceSpec(kind, element.name, served, True))
        return
    check_medium(element, media)
    noise = []
    if element.name in argos.WHEELS and kind == ACTUATORS and rule.stage is not Stage.RUN:
        devices.wheel_noise = _read_wheel_noise(element)
        noise = _noise(element)
        _pass_over_unread(element)
    else:
        argos.pass_over(element, argos.SIMULATED_SETTINGS)
        argos.pass_over(element, argos.SIMULATED_WHEELS if element.name in argos.WHEELS else {})
    own = argos.OWN_DEVICES[kind].get(element.name)
    if own is None:
        element.leave_out(argos.VIRTUAL_ONLY)
        devices.declared.append(_nobodys(element, kind))
        return
    if own.board:
        element.warn(argos.BOARD_HINT)
    served = ", ".join([f"the robot's own {own.name!r}", *noise])
    devices.declared.append(DeviceSpec(kind, element.name, served, True))


def _read_wheel_noise(element: Element) -> WheelNoise | None:
    """Reads the noise of simulated wheels; None where they obey."""
    if element.name == "epuck_wheels":
        relative = element.number("noise_std_dev", 0.0, _MAX_WHEEL_NOISE, default=0.0)
        return WheelNoise(relative=(relative, relative)) if relative > 0.0 else None
    quiet = WheelNoise()
    pairs = {
        field: _wheels(element, key, getattr(quiet, field))
        for field, key in argos.STEERING_NOISE.items()
    }
    return None if (noise := WheelNoise(**pairs)) == quiet else noise


def _wheels(element: Element, key: str, default: Wheels) -> Wheels:
    """Reads a number for both wheels, which each may have of its own."""
    low, high = -_MAX_WHEEL_NOISE, _MAX_WHEEL_NOISE
    left, right = default
    if element.has(key):
        left = right = element.number(key, low, high)
    return (
        element.number(f"{key}_left", low, high, default=left),
        element.number(f"{key}_right", low, high, default=right),
    )


def _mount_argos(element: Element, kind: str, scope: Scope) -> MountedSensor | MountedActuator:
    module = of_argos(kind)[element.name]
    device = module.from_argos(element, scope)
    if kind == SENSORS:
        return _mounted_sensor(element, device, module.ARGOS_NOISE)
    return MountedActuator(device, element.line, Quality.from_xml(element, device.scale, ()))


def _pass_over_unread(element: Element) -> None:
    """Passes over what ARGoS's simulated device does not obey either; only noise is missed."""
    for key, (kind, _) in argos.SIMULATED_SETTINGS.items():
        if not element.was_asked(key):
            lost = "this device has no such noise in ARGoS" if key in NOISES else ""
            argos.pass_over(element, {key: (kind, lost)})


def _device(mounted: MountedSensor | MountedActuator) -> VirtualSensor | VirtualActuator:
    return mounted.sensor if isinstance(mounted, MountedSensor) else mounted.actuator


def _add(
    devices: Devices, kind: str, element: Element, mounted: MountedSensor | MountedActuator
) -> None:
    """Notes a virtual device in its controller's table, where it has a name and room."""
    device = _device(mounted)
    _add_entry(devices.entries, element, device, _WAYS[kind])
    if isinstance(mounted, MountedSensor):
        devices.sensors.append(mounted)
    else:
        devices.actuators.append(mounted)
    constant = ["always full, as in ARGoS"] if element.name in argos.BATTERIES else []
    served = ", ".join([f"virtual, as {device.name!r}", *constant, *_noise(element)])
    devices.declared.append(DeviceSpec(kind, element.name, served, True))


def _noise(element: Element) -> list[str]:
    """The noise that a device's element has asked for."""
    said = {key: element.peek(key) for key in argos.NOISE if element.was_asked(key)}
    return [f"{key} {text.strip()}" for key, text in said.items() if text and text.strip("0. ")]


def _add_entry(
    entries: _Entries, element: Element, device: VirtualSensor | VirtualActuator, way: Direction
) -> None:
    name = device.name
    if name in entries:
        entry, line = entries[name]
        kind = entry.direction.name.lower()
        message = f"the {kind} {name!r} is there already, in line {line}; expected another name"
        raise element.error(message)
    entries[name] = (Entry(len(entries) + 1, name, device.layout, way), element.line)
    try:
        Table(entry for entry, _ in entries.values())
    except WireError as error:
        raise element.error(str(error)) from None
