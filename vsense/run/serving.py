"""The virtual sensor server of an experiment."""

from __future__ import annotations

from collections.abc import Callable

from vsense.config.specs import Experiment
from vsense.link.server import LinkEvent, VirtualSensorServer
from vsense.link.table import Table


def make_server(
    experiment: Experiment,
    table: Table,
    address: tuple[str, int],
    seed: int,
    on_event: Callable[[LinkEvent], None],
) -> VirtualSensorServer:
    """Prepares the server that an experiment's robots connect to; nothing is opened yet.

    Args:
        experiment: whose robots are expected.
        table: the sensor table.
        address: interface to listen on, and its port; 0 takes a free one.
        seed: of the run.
        on_event: called from the server's thread; must not wait.

    Raises:
        WireError: params or timestep do not fit the protocol.
    """
    host, port = address
    return VirtualSensorServer(
        host=host,
        port=port,
        table=table,
        timestep_ns=round(1e9 / experiment.ticks_per_second),
        seed=seed,
        params=experiment.controller.params_text,
        expected={robot.tag: robot.id for robot in experiment.robots},
        on_event=on_event,
    )
