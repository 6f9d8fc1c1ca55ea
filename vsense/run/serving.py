"""The virtual sensor server of an experiment."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from vsense.config.specs import Experiment
from vsense.link.legacy import MixedServer
from vsense.link.legacy_robots import LegacySwarm, by_octet
from vsense.link.legacy_wire import Translation
from vsense.link.server import LinkEvent, VirtualSensorServer
from vsense.link.table import Table


def make_server(
    experiment: Experiment,
    table: Table,
    address: tuple[str, int],
    seed: int,
    on_event: Callable[[LinkEvent], None],
    legacy_port: int | None = None,
) -> VirtualSensorServer:
    """Prepares the server that an experiment's robots connect to; nothing is opened yet.

    Args:
        experiment: whose robots are expected.
        table: the sensor table.
        address: interface to listen on, and its port; 0 takes a free one.
        seed: of the run.
        on_event: called from the server's thread; must not wait.
        legacy_port: port for robots with the original's client, None: none are served.

    Raises:
        WireError: params or timestep do not fit the protocol.
        LinkError: the original's client cannot be served in this experiment.
    """
    host, port = address
    options: dict[str, Any] = {
        "host": host,
        "port": port,
        "table": table,
        "timestep_ns": experiment.timestep_ns,
        "seed": seed,
        "params": experiment.controller.params_text,
        "expected": {robot.tag: robot.id for robot in experiment.robots},
        "on_event": on_event,
    }
    if legacy_port is None:
        return VirtualSensorServer(**options)
    numbers = by_octet({robot.tag: (robot.id, robot.number) for robot in experiment.robots})
    swarm = LegacySwarm(Translation(table.entries), numbers)
    return MixedServer((host, legacy_port), swarm, **options)
