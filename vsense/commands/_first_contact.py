"""First contact with one robot: what is asked about it, and what is tried before it plays.

What follows from its model stands here; all else is the roster's (`robot_init.py`).
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from vsense.base.errors import UsageError
from vsense.base.terminal import Console
from vsense.commands import _arguments
from vsense.config.roster import Roster
from vsense.robots import build
from vsense.robots.drivers import Driver

CHECK_S = 60.0
"""A check that takes longer has failed: an interpreter, its packages and a connection fit."""

_STANDS = "stand_still"
_TOLD = ("base", "wiggle")
"""Lines of `vsensed --check` that are the robot's own."""


@dataclass(frozen=True, slots=True)
class _Kind:
    """A model whose base is known.

    Attributes:
        address: what its address is, as it is asked for.
        base: with {} for the address; "": that is of its board, which has a base of its own.
    """

    address: str
    base: str = ""


_KINDS: Mapping[str, _Kind] = {
    "epuck": _Kind("its board, as ssh takes it, such as root@192.168.1.30"),
    "pipuck": _Kind("its board, as ssh takes it, such as pi@192.168.1.30"),
    "epuck2": _Kind("its own address on the Wi-Fi, such as 192.168.1.40", "wifi:{}"),
    "thymio2": _Kind("its cable or dongle, such as /dev/ttyACM0", "exec:thymio {}"),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares what `--add` takes where nobody is asked."""
    text = f"with --add: which robot it is: {', '.join(_KINDS)}, or a model of yours"
    _arguments.option(parser, "--model", str, "NAME", text)
    text = "with --add: where it is reached, without a board: its IP address, or its cable's device"
    _arguments.option(parser, "--address", str, "ADDRESS", text)
    text = "with --add: the number of the marker that it wears (default: one that nobody has)"
    _arguments.option(parser, "--tag", _arguments.natural, "N", text)
    text = "with --add: turn it a little on its place, there and back; it needs 10 cm around it"
    _arguments.flag(parser, "--wiggle", text)


def complete(options: argparse.Namespace, free_tag: Callable[[], int]) -> argparse.Namespace:
    """The options with what follows from them, and what a person answers who sits before it.

    `free_tag` gives the tag that the robot would have. UsageError: an answer makes no sense, or
    options of `--add` are given without it.
    """
    given = [name for name in ("model", "address", "tag") if getattr(options, name) is not None]
    if options.add is None:
        if given or options.wiggle:
            raise UsageError(f"--{[*given, 'wiggle'][0]} is of one robot: expected --add NAME, too")
        return options
    told = vars(options)
    if sys.stdin is not None and sys.stdin.isatty():
        told = told | _asked(told, free_tag)
    kind = _KINDS.get(told["model"] or "")
    if kind is not None and told["address"] is not None and told["base"] is None:
        if kind.base:
            told = told | {"base": kind.base.format(told["address"])}
        elif not told["hosts"]:
            told = told | {"hosts": [[told["address"]]]}
    return argparse.Namespace(**told)


def _asked(told: Mapping[str, Any], free_tag: Callable[[], int]) -> dict[str, Any]:
    answers = dict[str, Any]()
    model = told["model"]
    if model is None and told["base"] is None:
        known = ", ".join(_KINDS)
        model = answers["model"] = _answer(
            f"Which robot is it: {known}, or a model of yours", "epuck"
        )
    kind = _KINDS.get(model or "")
    if told["address"] is None and told["base"] is None and not told["hosts"]:
        if kind is None:
            question = "What turns its wheels, as vsensed --base (vsense docs drivers)"
            answers["base"] = _answer(question)
        else:
            answers["address"] = _answer(f"Where is it: {kind.address}")
    if told["tag"] is None:
        tag = _answer("Which marker does it wear", str(free_tag()))
        answers["tag"] = _number(tag)
    return answers


def _number(text: str) -> int:
    try:
        return _arguments.natural(text)
    except argparse.ArgumentTypeError as error:
        raise UsageError(f"marker: {error}; nothing is written") from None


def _answer(question: str, usual: str = "") -> str:
    sys.stderr.write(f"{question}{f' [{usual}]' if usual else ''}: ")
    sys.stderr.flush()
    line = sys.stdin.readline()
    if not line.strip() and (not usual or not line):
        raise UsageError(f"{question}: no answer; nothing is written")
    return line.strip() or usual


def try_robot(roster: Roster, tag: int, options: argparse.Namespace, console: Console) -> int:
    """Has a daemon of this machine look at a robot that it drives, and says what it finds.

    Returns:
        0: it answers, and turns where that was asked for, or it has a board; 1.

    Raises:
        UsageError: it has a board, and is to turn.
        BuildError: no daemon can be built.
    """
    robot = roster.get(tag)
    assert robot is not None
    if options.model is not None:
        console.say(f'in the experiment it is <e-puck vs:model="{options.model}">')
    if not robot.is_driven_here:
        if options.wiggle:
            raise UsageError(
                f"{robot} has a board, which drives it: vsense robot deploy first, then"
                " vsensed --config /etc/vsensed.conf --wiggle there; it is in the roster"
            )
        return 0
    driver = Driver.of(robot.base, roster.path.parent)
    daemon = build.daemon(_STANDS)
    words: dict[str, Any] = {"--tag": tag, "--uid": "0" * 32, "--host": "127.0.0.1", "--port": 9}
    words["--base"] = robot.base if driver is None else driver.here()
    command = [str(word) for pair in words.items() for word in pair]
    flags = ["--insecure", "--check", *(["--wiggle"] if options.wiggle else [])]
    lines, bad = _checked([str(daemon), *command, *flags])
    for line in lines:
        console.say(f"{robot}: {line}", "warning" if bad else "info")
    return int(bad)


def _checked(command: Sequence[str]) -> tuple[list[str], bool]:
    """What a daemon says of its robot, and whether something is wrong with it."""
    try:
        done = subprocess.run(
            command,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            encoding="utf-8",
            errors="replace",  # a driver may say anything
            timeout=CHECK_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return [f"BAD  the check has not ended within {CHECK_S:g} s"], True
    lines = [line for line in done.stdout.splitlines() if next(iter(line.split()), "") in _TOLD]
    bad = not lines or any(" BAD " in line for line in lines)
    return [*lines, *(done.stderr.splitlines()[-1:] if bad else [])], bad
