"""`vsense robot emulate`: the robots and the tracker of a `vsense run`, without robots."""

from __future__ import annotations

import argparse
import shlex
from contextlib import closing
from ipaddress import IPv4Address
from pathlib import Path

from vsense.base.errors import UsageError
from vsense.base.interruption import interruption
from vsense.base.terminal import Console
from vsense.commands import _arguments, _experiments, _hardware, _rosters
from vsense.config.experiment import first_robots, load, of_folder
from vsense.config.placement import settle
from vsense.config.specs import LINES_PORT, Experiment, JsonLinesTracker, Stage
from vsense.modes.lab.hardware import BASES
from vsense.modes.lab.rehearsal import LineWriter, Rehearsal
from vsense.modes.live.opening import LinkOptions
from vsense.modes.options import choose_seed
from vsense.run import directory as run_directory


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the action's arguments."""
    parser.add_argument(
        "robots",
        type=_arguments.positive,
        nargs="?",
        metavar="N",
        help=f"{_experiments.ROBOTS} (default: the file's)",
    )
    text = (
        "whose robots, controllers and walls: a shipped experiment's name, or the path of a"
        f" .argos file (default: {_experiments.DEFAULT})"
    )
    _arguments.option(parser, "--experiment", of_folder, "NAME", text, _experiments.DEFAULT)
    _arguments.add_code(parser)
    _rosters.add_casting(parser)
    _add_ends(parser)
    _arguments.add_bases(parser, BASES)
    _hardware.add_radios(parser)
    _experiments.add_key(parser)
    _experiments.add_insecure(
        parser, "give the robots no keys: for a run that is --insecure, too", page=False
    )
    text = "seed of places, clocks and noise (default: the file's; 0 draws a fresh one)"
    _arguments.option(parser, "--seed", _arguments.natural, "N", text)
    _arguments.option(
        parser, "-o --output", Path, "DIR", "folder for the robots' logs (default: runs/...)"
    )


def _add_ends(parser: argparse.ArgumentParser) -> None:
    text = "numeric IPv4 address of the machine with `vsense run` (default: the file's vss_host)"
    _arguments.option(parser, "--host", _ipv4, "ADDRESS", text)
    _arguments.option(
        parser, "--port", _arguments.port, "P", "its port for robots (default: the file's vss_port)"
    )
    text = (
        "its port for lines of a tracker (default: that of the file's <vs:tracker>, else"
        f" {LINES_PORT})"
    )
    _arguments.option(parser, "--tracker-port", _arguments.port, "P", text)


def _ipv4(text: str) -> str:
    """A numeric IPv4 address, as `vsensed --host` takes it."""
    try:
        return str(IPv4Address("127.0.0.1" if text == "localhost" else text))
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"'{text}': expected a numeric IPv4 address, such as 10.0.0.1"
        ) from None


def run(options: argparse.Namespace) -> int:
    """Emulates robots until Ctrl-C or SIGTERM; returns 130 or 143."""
    casting = _rosters.casting_of(options, here=True)
    code = _arguments.code_of(options)
    loaded = load(options.experiment, stage=Stage.LAB, code=code, casting=casting)
    experiment = first_robots(loaded, options.robots)
    radios = _hardware.radios_of(options, experiment)
    keys = None if options.insecure else _experiments.trust_of(options).keys
    seed = choose_seed(options.seed, experiment)
    experiment = settle(experiment, seed)
    host, robots_port = address = LinkOptions(options.host, options.port).address(experiment)
    port = _lines_port(options, experiment)
    if port == robots_port:
        raise UsageError(
            f"{port} is both the port for robots and that for the tracker's lines: expected two;"
            " see --port and --tracker-port"
        )
    directory = run_directory.make(options.output, f"{experiment.name}-emulated", seed)
    console = Console()
    tracker = LineWriter(host, port, console.say)
    with interruption() as interrupted:
        console.say(
            f"{experiment.name}: {len(experiment.robots)} emulated robots, seed {seed}; logs in"
            f" {directory}"
        )
        setting = (options.base, options.firmware_watchdog, address, keys)
        more = tracker, console.say, radios
        with closing(Rehearsal(experiment, directory, seed, *setting, *more)) as rehearsal:
            console.say(f"they connect to {host}, port {address[1]}; their tracker to port {port}")
            command = _command(options, address[1], port)
            console.say(f"without cameras, in another terminal: {command}")
            try:
                rehearsal.run(interrupted, console.progress)
            finally:
                console.end_progress()
    return interrupted.code


def _lines_port(options: argparse.Namespace, experiment: Experiment) -> int:
    """Where the run waits for lines of a tracker."""
    if options.tracker_port is not None:
        return int(options.tracker_port)
    named = experiment.tracker
    return (named.port or LINES_PORT) if isinstance(named, JsonLinesTracker) else LINES_PORT


def _command(options: argparse.Namespace, port: int, lines_port: int) -> str:
    words = ["vsense", "run", options.experiment]
    words += ["--tracker", "lines" if lines_port == LINES_PORT else f"lines:{lines_port}"]
    words += [] if options.port is None else ["--port", str(port)]
    words += [] if options.roster is None else ["--roster", str(options.roster)]
    for out, new in options.replace:
        words += ["--replace", f"{out}={new}"]
    words += [] if options.robots is None else ["--robots", str(options.robots)]
    words += [] if options.key is None else ["--key", str(options.key)]
    return shlex.join(words + (["--insecure"] if options.insecure else []))
