"""Robots that this machine drives: a `vsensed` each, for those whose base is reached from here.

They are those of the roster with a base and no board of their own: an e-puck2 on its Wi-Fi, or a
driver with a dongle. Where this machine loses power, or the radio breaks, nobody stops them but
they themselves.
"""

from __future__ import annotations

import hashlib
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path

from vsense.base.clock import host_ns
from vsense.base.errors import VsenseError, failing_as
from vsense.base.files import cut_log, log_ends
from vsense.base.processes import Lifeline, describe_exit, terminate
from vsense.base.terminal import Level
from vsense.config.roster import Roster, RosterRobot, read
from vsense.config.specs import Experiment, RobotSpec
from vsense.robots import build
from vsense.robots.drivers import Driver
from vsense.robots.link.keys import KeySource, daemon_options

AGAIN_NS = 2_000_000_000
"""From the start of a daemon that has ended to the next one's."""

Say = Callable[[str, Level], None]


class OwnDaemons:
    """The daemons that this machine runs for robots; a folder holds their keys and logs.

    They are in sessions of their own: Ctrl-C is the run's to handle, which has them stop.
    """

    def __init__(self, address: tuple[str, int], keys: KeySource | None, say: Say) -> None:
        """Starts none yet; robots connect to `address`, with keys made of `keys`, if there are."""
        host, self._port = address
        self._host = "127.0.0.1" if host in ("0.0.0.0", "localhost", "") else host
        self._keys, self._say = keys, say
        self._folder = tempfile.TemporaryDirectory(prefix="vsense-daemons-")
        self._commands: dict[int, list[str]] = {}
        self._processes: dict[int, subprocess.Popen[bytes]] = {}
        self._again_ns: dict[int, int] = {}
        self._lifeline = Lifeline()

    def serve(self, experiment: Experiment) -> None:
        """Has a daemon for each robot of an experiment that is reached from here, and no others.

        Raises:
            UsageError: the roster cannot be read.
            BuildError: one cannot be built.
            VsenseError: a key's file cannot be written.
        """
        named = experiment.casting.roster
        roster = read(Path(named)) if named else None
        reached = {} if roster is None else _reached(experiment, roster)
        for tag in self._commands.keys() - reached.keys():
            del self._commands[tag]
            if (process := self._processes.pop(tag, None)) is not None:
                terminate([process])
        fresh = reached.keys() - self._commands.keys()
        programs = {c.id: c.program for c in experiment.controllers}
        for robot in experiment.robots:
            if roster is not None and robot.tag in fresh:
                daemon = build.daemon(programs[robot.controller])
                known = reached[robot.tag]
                self._commands[robot.tag] = self._command(daemon, robot, known, roster)
                self._start(robot.tag)
        if fresh:
            names = ", ".join(map(str, sorted(fresh)))
            self._say(
                f"driven from this machine: {names}. If it loses power, or their radio breaks, only"
                " they themselves can stop: vsense docs drivers",
                "warning",
            )

    def look(self) -> None:
        """Starts those again that have ended, and says so; keeps their logs in bounds.

        VsenseError: a log that is too long cannot be cut.
        """
        for tag, process in [*self._processes.items()]:
            with failing_as(VsenseError, f"cannot cut {self._log(tag)}"):
                cut_log(self._log(tag))
            if process.poll() is not None:
                del self._processes[tag]
                last = log_ends(self._log(tag)).splitlines()[-1:]
                words = f"robot {tag}: its vsensed here {describe_exit(process.returncode)}"
                self._say(": ".join([words, *last]), "trouble")
        for tag in self._commands.keys() - self._processes.keys():
            if host_ns() >= self._again_ns[tag]:
                self._start(tag)

    def close(self) -> None:
        """Ends all: their robots stop."""
        terminate(self._processes.values())
        self._lifeline.close()
        self._folder.cleanup()

    def _start(self, tag: int) -> None:
        self._again_ns[tag] = host_ns() + AGAIN_NS
        self._processes[tag] = self._lifeline.start(self._commands[tag], self._log(tag))

    def _log(self, tag: int) -> Path:
        return Path(self._folder.name) / f"{tag}.log"

    def _command(
        self, daemon: Path, robot: RobotSpec, known: RosterRobot, roster: Roster
    ) -> list[str]:
        driver = Driver.of(known.base, roster.path.parent)
        base = known.base if driver is None else driver.here()
        settings = {"host": self._host, "port": str(self._port), "tag": str(robot.tag)}
        settings |= {"name": robot.id, "base": base, **roster.settings_of(known)}
        if stop_mv := known.board.get("battery_stop_mv"):
            settings["battery-stop-mv"] = stop_mv
        words = [word for name, value in settings.items() for word in (f"--{name}", value)]
        uid = bytes.fromhex(known.uid) if known.uid else _uid(robot.tag)
        file = Path(self._folder.name) / f"{robot.tag}.key"
        return [str(daemon), *words, *daemon_options(uid, self._keys, file)]


def _reached(experiment: Experiment, roster: Roster) -> dict[int, RosterRobot]:
    """The experiment's robots that have no board: their base is reached from here."""
    known = (roster.get(robot.tag) for robot in experiment.robots)
    return {robot.tag: robot for robot in known if robot is not None and robot.is_driven_here}


def _uid(tag: int) -> bytes:
    """Who a robot is that has no board, and whose roster does not say it."""
    return hashlib.sha256(f"vsense robot without a board {tag}".encode()).digest()[:16]
