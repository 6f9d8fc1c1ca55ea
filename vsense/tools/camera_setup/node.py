"""`vsense camera node`: looks at this computer's cameras for a tracker on another one."""

from __future__ import annotations

import socket
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from vsense.base.clock import host_ns
from vsense.base.errors import UsageError
from vsense.base.interruption import interruption
from vsense.base.terminal import Console
from vsense.config import resources as resources_file
from vsense.vision.tracking.node import CameraNode
from vsense.vision.tracking.node_session import (
    NODE_NAME,
    NodeNetwork,
    check_endpoint,
    require_zenoh,
)


@dataclass(frozen=True, slots=True)
class NodeOptions:
    """What `vsense camera node` is asked for.

    Attributes:
        resources: Path of the resources file: its grabbers are what the node has.
        connect: Addresses of the tracker or of a router, such as `tcp/10.0.0.2:7447`.
        name: What the tracker's resources file calls it; None: as this computer is called.
        arena: As in the tracker's resources file.
        config: A file of Zenoh's configuration; None: none.
    """

    resources: str
    connect: tuple[str, ...]
    name: str | None = None
    arena: str = "arena"
    config: Path | None = None


def run(options: NodeOptions, clock: Callable[[], int] = host_ns) -> int:
    """Serves trackers until Ctrl-C or SIGTERM; returns 130 or 143.

    `clock` dates pictures [ns]. Raises VsenseError where a file, an address or the network cannot
    be used.
    """
    require_zenoh()
    name = options.name or socket.gethostname().partition(".")[0]
    for option, word in (("--name", name), ("--arena", options.arena)):
        if not NODE_NAME.fullmatch(word):
            raise UsageError(f"{option}: {word[:40]!r}: expected letters, digits, '_', '.', '-'")
    try:
        connect = tuple(map(check_endpoint, options.connect))
    except UsageError as error:
        raise UsageError(f"--connect: {error}") from None
    network = NodeNetwork((), connect, options.config, options.arena)
    resources = resources_file.load(options.resources)
    console = Console()
    with interruption() as interrupted:
        node = CameraNode(resources, network, name, clock, console.say)
        with closing(node):
            console.say(f"node {name} of {options.arena}, for the tracker at {', '.join(connect)}")
            node.run(interrupted)
    return interrupted.code
