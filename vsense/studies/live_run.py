"""A run in the lab or with real robots, from Python: it goes on in a process of its own.

    with vsense.load("foraging").lab(duration=20) as lab:
        print(lab.status["run"]["time_s"])
        run = lab.wait()
    print(run.measures)

The process is the command, `vsense lab` or `vsense run`, with the options that one would type. It
ends in order, wheels first, with the `with` block, and when the process that started it is gone.
"""

from __future__ import annotations

import math
import os
import runpy
import signal
import subprocess
import tempfile
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from vsense.base import processes
from vsense.base.errors import UsageError, VsenseError
from vsense.base.terminal import Console
from vsense.config.specs import Experiment
from vsense.monitor.ui import control_client
from vsense.run.directory import SUMMARY
from vsense.studies.results import FinishedRun, RunTable

_POLL_S = 0.05
_END_TIMEOUT_S = 60.0
"""Figures and pictures of a run that was stopped may take so long."""
_PAGE = "control room: "


class LiveRun:
    """The command that runs an experiment; ends with the `with` block.

    Attributes:
        words: the command and its options, as one would type them.
        folder: for what its runs leave.
    """

    def __init__(
        self,
        words: tuple[str, ...],
        folder: Path,
        progress: bool,
        experiment: Experiment | None = None,
    ) -> None:
        """Starts the command and waits until it has begun; `progress`: what it says is printed.

        Raises:
            UsageError: an option is wrong, or something does not go together.
            VsenseError: it cannot begin.
        """
        self.words, self.folder, self._experiment = words, folder, experiment
        # A pipe would break when this process is gone, and the command with it.
        self._log, self._printed = tempfile.TemporaryFile(), 0  # noqa: SIM115
        self._console = Console() if progress else None
        module = processes.python_module(__name__)
        self._process = subprocess.Popen(
            [*module, *words, "-o", str(folder)],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=self._log,
            start_new_session=True,
        )
        try:
            while self._process.pid not in control_client.alive():
                if not self.goes_on:
                    raise self._failure()
                self._show()
                time.sleep(_POLL_S)
        except BaseException:
            self.close()
            raise

    def _show(self) -> None:
        """Prints what is new of what the command has said."""
        if self._console is not None:
            said = self.said
            for line in said[self._printed :]:
                self._console.say(line)
            self._printed = len(said)

    def _failure(self) -> VsenseError:
        code, said = self._process.returncode, self.said
        about = [line for line in said if line.startswith("vsense: ")] or said
        words = about[-1].removeprefix("vsense: ") if about else processes.describe_exit(code)
        return UsageError(words) if code == UsageError.exit_code else VsenseError(words)

    @property
    def goes_on(self) -> bool:
        """Whether the command has not ended yet."""
        return self._process.poll() is None

    @property
    def said(self) -> list[str]:
        """What it has said so far, line by line."""
        size = os.fstat(self._log.fileno()).st_size
        text = os.pread(self._log.fileno(), size, 0).decode(errors="replace")
        return text[: text.rfind("\n") + 1].splitlines()

    @property
    def page(self) -> str | None:
        """The control room's address, with the option `web`; None: there is none."""
        pages = (line.removeprefix(_PAGE) for line in self.said if line.startswith(_PAGE))
        return next(pages, None)

    @property
    def status(self) -> dict[str, Any]:
        """How it is, as `vsense control status --json` says: `run` and `robots`.

        Raises:
            VsenseError: it has ended.
        """
        return self._ask({"ask": "status"})

    def order(self, kind: str) -> str:
        """Gives an order of `vsense control`: start, pause, stop, reset, emergency.

        Gives what it answers. VsenseError: it refuses the order, or has ended.
        """
        return str(self._ask({"order": kind, "by": "python"})["text"])

    def _ask(self, question: Mapping[str, Any]) -> dict[str, Any]:
        if not self.goes_on:
            raise VsenseError(f"vsense {' '.join(self.words[:2])} has ended")
        return control_client.ask(question, self._process.pid)

    def wait(self, timeout_s: float | None = None) -> FinishedRun:
        """Waits for its end; gives its last run, which may be invalid.

        Raises:
            VsenseError: it has failed, and left no run; or it goes on after `timeout_s`.
        """
        until_s = math.inf if timeout_s is None else time.monotonic() + timeout_s
        while self.goes_on:
            if time.monotonic() > until_s:
                raise VsenseError(f"it goes on after {timeout_s:g} s")
            self._show()
            time.sleep(_POLL_S)
        self._show()
        runs = sorted(self.folder.glob("run-*"), key=lambda path: int(path.name[4:]))
        for folder in (*reversed(runs), self.folder):
            if os.path.exists(folder / SUMMARY):
                return FinishedRun(folder, self._experiment)
        raise self._failure()

    @property
    def table(self) -> RunTable:
        """All of its runs that are over."""
        return RunTable(self.folder / "runs.csv")

    def close(self) -> None:
        """Ends it, in order; can be called again."""
        if self.goes_on:
            self._process.terminate()
        processes.end(self._process, _END_TIMEOUT_S)
        assert self._process.stdin is not None
        self._process.stdin.close()

    def __enter__(self) -> LiveRun:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _repr_html_(self) -> str:
        return f"<code>vsense {' '.join(self.words)}</code>"


def options_as_words(options: Mapping[str, Any]) -> tuple[str, ...]:
    """A command's options as one types them: True is a flag, a list is several words.

    None and False are options that are not given.
    """
    words = list[str]()
    for name, value in options.items():
        if value is None or value is False:
            continue
        given = value if isinstance(value, (list, tuple)) else [value]
        words += [f"--{name.replace('_', '-')}", *(str(v) for v in given if v is not True)]
    return tuple(words)


def _end_with_parent() -> None:
    """In a thread: asks this process to end, in order, when the one that has started it is gone."""
    while os.read(0, 4096):
        pass
    os.kill(os.getpid(), signal.SIGTERM)


if __name__ == "__main__":
    threading.Thread(target=_end_with_parent, daemon=True).start()
    runpy.run_module("vsense", run_name="__main__", alter_sys=True)
