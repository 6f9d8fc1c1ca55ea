"""What is checked and taken before robots hear of an experiment: ports, keys, the robots."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager, ExitStack, nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path

from vsense.base import sharing
from vsense.base.errors import UsageError, require
from vsense.base.terminal import Console
from vsense.config.experiment import first_robots
from vsense.config.specs import (
    LINES_PORT,
    Experiment,
    JsonLinesTracker,
    MocapTracker,
    TrackerAddress,
)
from vsense.modes.options import ExperimentOptions
from vsense.monitor.ui.access import is_loopback
from vsense.monitor.ui.control_socket import folder
from vsense.monitor.ui.room import RoomOptions
from vsense.robots import key_holders
from vsense.robots.link import keys, network
from vsense.robots.link.key_process import KeyProcess
from vsense.robots.link.keys import LinkTrust
from vsense.robots.link.legacy.server import MixedServer
from vsense.robots.link.server import VirtualSensorServer
from vsense.run.homing.starts import Starts
from vsense.run.leases import RobotLeases


@dataclass(frozen=True, slots=True)
class LinkOptions:
    """Where robots and arena states come from, and which robots are believed.

    Attributes:
        host, port: the interface and port that robots connect to; None: the experiment's.
        legacy_port: for robots with the original's client; None: they are not served.
        key: the swarm's keys; None: where they usually are.
        insecure: robots without a key are taken, too.
        tracking: two files of our own cameras; None: another tracker.
        tracker: see `with_tracker`.
        other_programs: robots that run another program than the file's are taken.
        link_check: the links are measured for so long [s] before the first run; 0: they are not.
    """

    host: str | None = None
    port: int | None = None
    legacy_port: int | None = None
    key: Path | None = None
    insecure: bool = False
    tracking: tuple[str, str] | None = None
    tracker: tuple[str, int] | None = None
    other_programs: bool = False
    link_check: float = 0.0

    def address(self, experiment: Experiment) -> tuple[str, int]:
        """Where robots of an experiment connect to."""
        host = experiment.host if self.host is None else self.host
        return host, experiment.port if self.port is None else self.port

    def in_lab(self, experiment: Experiment) -> LinkOptions:
        """For a lab: its own robots are told their port, and any that is free will do."""
        is_own = self.port is None and experiment.host.startswith("127.")
        return replace(self, port=0) if is_own else self


@dataclass(frozen=True, slots=True)
class StagedOptions:
    """How an experiment runs in real time, in the lab or with robots.

    Attributes:
        experiment: which, and how it is read.
        link: to the robots.
        room: how runs are seen, steered and kept.
        home, home_virtual_walls: robots drive to their starts before each run, also around virtual
            walls.
        battery: who has less [V] before a run rests in it.
        json: figures are printed on standard output.
    """

    experiment: ExperimentOptions
    link: LinkOptions = field(default_factory=LinkOptions)
    room: RoomOptions = field(default_factory=RoomOptions)
    home: bool = False
    home_virtual_walls: bool = False
    battery: float = 0.0
    json: bool = False

    def starts_of(self, experiment: Experiment) -> Starts | None:
        """Where robots drive before each run of an experiment of which nothing is placed yet.

        None: they stay where they are. ConfigError: there is no place for all.
        """
        if not (self.home or self.home_virtual_walls):
            return None
        taken = first_robots(experiment, self.experiment.robots)
        starts = Starts(taken, self.home_virtual_walls)
        starts.of(1)
        return starts


def check_ports(room: RoomOptions, link: LinkOptions, experiment: Experiment) -> None:
    """Refuses what page, recordings and ports lack, before anything is made or started.

    Raises:
        UsageError: a library is missing, or two are to have one port.
        VsenseError: the page's files cannot be used, or another program has a port.
    """
    (host, port), legacy_port = link.address(experiment), link.legacy_port
    if legacy_port and legacy_port == port:
        raise UsageError(
            f"--legacy-port: {port} is the port for vsensed, too: give that another, such as"
            f" --port {port + 1}"
        )
    room.check(port, legacy_port)
    with ExitStack() as stack:
        robots = network.bind(host, port)
        stack.callback(robots.tcp.close)
        stack.callback(robots.udp.close)
        if legacy_port:
            stack.callback(network.listen(host, legacy_port)[0].close)
        if room.web is not None:
            stack.callback(network.listen(room.web.host, room.web.port)[0].close)


def require_source(experiment: Experiment, tracking: tuple[str, str] | None) -> None:
    """Raises UsageError if neither the command line (`tracking`) nor the experiment names one, or
    the package that it needs is missing."""
    if tracking is None and isinstance(experiment.tracker, MocapTracker):
        require("motion capture needs", "motioncapture")
    if tracking is None and experiment.tracker is None:
        raise UsageError(
            f"{experiment.file} names no tracker: give --tracking RESOURCES.xml SESSION.xml for"
            ' cameras of your own, --tracker WHERE for another one, or ats_host="..." or'
            ' <vs:tracker format="lines" /> in its <framework>'
        )


def with_tracker(experiment: Experiment, where: tuple[str, int] | None) -> Experiment:
    """The experiment with another tracker.

    Args:
        where: its host and port, 0 is the usual one; "" is one that connects and writes lines.
            None: the experiment's own.
    """
    if where is None:
        return experiment
    (host, port), named = where, experiment.tracker
    if not host:
        lines = JsonLinesTracker("127.0.0.1", LINES_PORT, 0)
        lines = named if isinstance(named, JsonLinesTracker) else lines
        return replace(experiment, tracker=replace(lines, port=port or lines.port))
    original = TrackerAddress(host, port, (0.0, 0.0), 0.0, 0)
    original = named if isinstance(named, TrackerAddress) else original
    return replace(experiment, tracker=replace(original, host=host, port=port))


def lease_robots(
    tags: Iterable[int], command: str, name: str, host: str
) -> AbstractContextManager[RobotLeases | None]:
    """Takes real robots, before any hears of it; a context with their leases.

    Those that are on this machine, where nobody else's can connect, are emulated: any run may have
    its own of them, and there are no leases.

    Args:
        tags: of the robots; there may be none yet.
        command, name: what is done with them, and the experiment, for others.
        host: where they connect to.

    Raises:
        LeasedError: another run has some of them.
        SharingError: this account may not use the lab's robots, or its folder is not safe.
        ControlSocketError: likewise this account's own folder.
    """
    if is_loopback(host):
        return nullcontext()
    lab = sharing.lab()
    leases = RobotLeases(folder() if lab is None else lab.path, command, name)
    leases.take(tags)
    return leases


def trust_of(path: Path | None, insecure: bool) -> LinkTrust:
    """Which robots are believed.

    Args:
        path: the swarm's keys; None: where they usually are.
        insecure: robots without a key are taken, too.

    Raises:
        UsageError: there are no keys, and robots without one are not to be taken.
        VsenseError: the keys cannot be used.
    """
    file = path or keys.default_path()
    if path is None and not os.path.exists(file):
        if insecure:
            return keys.INSECURE
        raise UsageError(
            f"no swarm key ({file}): 'vsense robot keys --new-key' makes it, 'vsense robot deploy'"
            " brings each robot its own; or go on without keys: --insecure"
        )
    return key_holders.trust(key_holders.file_of(file), KeyProcess(file), insecure)


def say_trust(trust: LinkTrust, say: Callable[[str], None]) -> None:
    """Says where anybody could be a robot, and which former keys are still believed."""
    for note in trust.notes:
        say(note)
    if trust.insecure:
        say("--insecure: robots without a key are taken; anyone on the network can drive them")


def say_link(server: VirtualSensorServer, doubts: Sequence[str], console: Console) -> None:
    """Says where robots with the original's client connect to, what they do not get, and how other
    machines could move robots without showing who they are."""
    if isinstance(server, MixedServer):
        console.say(f"and with the original client on port {server.legacy_port}")
        for name in server.unknown:
            console.say(f"the original client does not know the sensor '{name}': not sent to it")
    for doubt in doubts:
        console.say(f"not authenticated: {doubt}", "warning")
