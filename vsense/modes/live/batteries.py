"""The batteries of a run's robots: a row for each in the roster's history, when the run is over.

Nothing is written while the robots move: a disk that takes its time delays no reading.
"""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from pathlib import Path

from vsense.config.battery_history import BatteryRow, append, history_of
from vsense.robots.link.status import RobotStatus


class RunBatteries:
    """What the robots of a run tell of their batteries.

    Args:
        roster: whose history is written; "": there is no roster, and nothing is written.
        timestep_s: length of a timestep.
    """

    def __init__(self, roster: str, timestep_s: float) -> None:
        self._roster, self._timestep_s = roster, timestep_s
        self._begun: dict[int, float | None] = {}
        self._newest: dict[int, tuple[str, float | None]] = {}
        self._timesteps = 0

    def update(self, run_timestep: int, robots: Mapping[int, RobotStatus]) -> None:
        """Takes the status of every robot by tag in a timestep of the run."""
        if not self._roster:
            return
        self._timesteps = run_timestep + 1
        for tag, status in robots.items():
            if not status.connected or status.telemetry is None:
                continue
            millivolts = status.telemetry.battery_mv
            volts = millivolts / 1e3 if millivolts else None
            if self._begun.get(tag) is None:
                self._begun[tag] = volts
            self._newest[tag] = ("" if status.uid is None else status.uid.hex(), volts)

    def end(self) -> Path | None:
        """Writes the rows of robots that were there, and forgets them; None: there were none.

        Raises:
            VsenseError: the history cannot be written.
        """
        now = datetime.now().astimezone().isoformat(timespec="seconds")
        duration_s = round(self._timesteps * self._timestep_s, 3)
        rows = [
            BatteryRow(now, tag, uid, self._begun[tag], volts, duration_s)
            for tag, (uid, volts) in self._newest.items()
        ]
        self._begun, self._newest, self._timesteps = {}, {}, 0
        if not rows:
            return None
        path = history_of(Path(self._roster))
        append(path, rows)
        return path
