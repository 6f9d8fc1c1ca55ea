"""`vsense` with a lab whose robots are behind the relay: `python -m tests.faults.lab lab ...`.

Each robot is told an address of its own for the host; all else is the lab as it is.
"""

from __future__ import annotations

import sys

from tests.faults.relay import NET, address
from vsense.cli import main
from vsense.modes.lab import _swarm


class FarSwarm(_swarm.LabSwarm):
    """The robots of the lab, far from it."""

    net = NET

    def _command(self, robot: _swarm.LabRobot) -> list[str]:
        words = super()._command(robot)
        words[words.index("--host") + 1] = address(self.robots.index(robot), self.net)
        return words


if __name__ == "__main__":
    _swarm.LabSwarm = FarSwarm  # type: ignore[misc]
    sys.exit(main())
