"""A `vsense camera track` whose runs orders begin and end."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from vsense.base.errors import VsenseError
from vsense.monitor.ui.control_client import ask

PATIENCE_S = 60.0


class Viewer:
    """A running `vsense camera track`, spoken to as `vsense control` speaks to it."""

    def __init__(self, words: list[str], states: Path, folder: Path) -> None:
        """Starts the command in `folder`; its standard output goes to the file `states`."""
        self.states = states
        with self.states.open("w") as out:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "vsense", *words],
                stdout=out, stderr=subprocess.PIPE, text=True, cwd=folder,
            )  # fmt: skip

    def order(self, kind: str) -> str:
        return str(ask({"order": kind, "by": "terminal"})["text"])

    def until(self, holds: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """Asks how it is until that is so."""
        end_s = time.monotonic() + PATIENCE_S
        while True:
            assert self.process.poll() is None, self.process.communicate()[1]
            assert time.monotonic() < end_s
            try:
                now: dict[str, Any] = ask({"ask": "status"})
                if holds(now["run"]):
                    return now
            except VsenseError as error:
                # It may not have opened its socket yet.
                assert "no experiment runs" in str(error), error
            time.sleep(0.02)

    def printed(self) -> list[dict[str, Any]]:
        return [json.loads(line) for line in self.states.read_text().splitlines()]

    def end(self) -> str:
        self.process.send_signal(signal.SIGINT)
        said = self.process.communicate(timeout=PATIENCE_S)[1]
        assert self.process.returncode == 130
        return str(said)
