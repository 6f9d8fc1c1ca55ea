"""The command `vsense`: reads arguments, makes every error one line and an exit code.

Exit codes: 0 ok, 1 failed, 2 wrong usage or input, 130 interrupted
(by SIGTERM: 143, by SIGHUP: 129). Standard output is data, standard error is talk.
"""

from __future__ import annotations

import atexit
import math
import os
import signal
import sys
from collections.abc import Sequence
from contextlib import suppress
from typing import NoReturn

from vsense.base.errors import VsenseError
from vsense.base.interruption import left_s
from vsense.base.processes import ForkedProcess
from vsense.base.terminal import Console, print_data

COMPLETING = "_ARGCOMPLETE"
"""This variable is set while a shell asks what may come next."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs one command and gives its exit code; `arguments` are by default those of the process."""
    codes: list[int] = []

    def leave(number: int, frame: object) -> NoReturn:
        """Ends the process where a command does not yet, or no more, look at signals by itself."""
        codes.append(128 + number)
        raise SystemExit(codes[0])

    if arguments is None:
        for number in (signal.SIGTERM, signal.SIGHUP):
            if signal.getsignal(number) == signal.SIG_DFL:  # `nohup` has SIGHUP ignored
                signal.signal(number, leave)
        if sys.argv[1:2] in (["sim"], ["compare"], ["optimize"]):
            ForkedProcess.allow()
    try:
        code = _run(list(sys.argv[1:] if arguments is None else arguments))
    except VsenseError as error:
        # Where the terminal has gone (SIGHUP) the exit code still says why.
        Console().print_only(f"vsense: {error}")
        code = error.exit_code
    except KeyboardInterrupt as error:  # which may say the signal, as `Interruption.code` does
        Console().print_only("vsense: interrupted")
        code = error.args[0] if error.args else 130
    except ImportError:
        if not codes:
            raise
        code = codes[0]  # NumPy makes an ImportError of whatever comes in the midst of its import
    # After SIGTERM no thread of a user's is waited for.
    if arguments is None and (ForkedProcess.is_safe() or left_s() < math.inf):
        _leave(code)
    return code


def _leave(code: int) -> NoReturn:
    """Ends the process without taking apart what it has in memory, which takes 20 ms."""
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with suppress(AttributeError, OSError):  # it may be closed, or there is none
            stream.flush()
    os._exit(code)


def _run(words: Sequence[str]) -> int:
    # Imported here, so that Ctrl-C is handled while the commands load.
    from vsense import commands
    from vsense.robots.link import strangers

    if COMPLETING in os.environ:
        from vsense.commands import completion

        completion.answer()
    strangers.raise_limit()
    if words[:1] == ["help"]:
        every = words[-1:] if words[-1] == "all" else []
        words = [*(word for word in words[1:] if word != "all"), "--help", *every]
    if not words:
        print_data(commands.START.rstrip())
        return 0
    words = commands.current(words)
    options = commands.parser(words).parse_args(words)
    return int(options.run(options))
