"""Types of command line arguments: each refuses with what was expected.

Opens the experiment that a command line names: `--set`, `--dry`, `--strict` and `--seed`.
"""

from __future__ import annotations

import argparse
import secrets
from collections.abc import Mapping
from pathlib import Path

from vsense.config.description import describe
from vsense.config.experiment import load
from vsense.config.specs import Experiment
from vsense.errors import VsenseError

MOST_NUMBERS = 100_000
"""A range of numbers may have so many."""


def seconds(text: str) -> float:
    """A length of time in s, at least one and finite."""
    value = _number(text, float, "a number of seconds")
    if not 1.0 <= value <= 86_400.0:
        raise argparse.ArgumentTypeError(f"{text}: expected 1 to 86400 seconds")
    return value


def natural(text: str) -> int:
    """A whole number of 32 bits, from 0."""
    return _integer(text, 0, 2**32 - 1)


def positive(text: str) -> int:
    """A whole number from 1 to 10000."""
    return _integer(text, 1, 10_000)


def process(text: str) -> int:
    """A process's number."""
    return _integer(text, 1, 2**31 - 1)


def port(text: str) -> int:
    """A TCP or UDP port, 0 for any free one."""
    return _integer(text, 0, 65_535)


def _integer(text: str, least: int, most: int) -> int:
    value = int(_number(text, int, "a whole number"))
    if not least <= value <= most:
        raise argparse.ArgumentTypeError(f"{text}: expected {least} to {most}")
    return value


def _number(text: str, kind: type[int] | type[float], expected: str) -> float:
    try:
        return kind(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is not {expected}") from None


def add_tracking_files(parser: argparse.ArgumentParser) -> None:
    """Declares the two files of a tracking session."""
    parser.add_argument(
        "resources", help="the resources file (arena_tracking_system): grabbers, trackers, cameras"
    )
    parser.add_argument(
        "experiment", help="the experiment file (arena_tracking): what of the resources to use"
    )


def setting(text: str) -> tuple[str, str]:
    """A setting of an experiment: ELEMENT.attribute=VALUE."""
    key, equals, value = text.partition("=")
    if not equals or "." not in key.strip("."):
        raise argparse.ArgumentTypeError(
            f"'{text}' is no ELEMENT.attribute=VALUE, such as sensor.noise=0.1"
        )
    return key, value


def add_experiment(parser: argparse.ArgumentParser) -> None:
    """Declares what all commands that run an experiment have in common."""
    parser.add_argument(
        "experiment", help="a shipped experiment's name, or the path of a .argos file"
    )
    parser.add_argument(
        "--dry",
        action="store_true",
        help="only say what the experiment holds, what of its file is not supported, and how many"
        " bytes a robot is sent and sends",
    )
    parser.add_argument(
        "--strict",
        action="store_true",
        help="refuse a file in which anything is not supported, instead of warning",
    )
    _add_run(parser)


def _add_run(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--duration",
        type=seconds,
        metavar="S",
        help="length of a run in s (default: the file's)",
    )
    parser.add_argument(
        "--seed",
        type=natural,
        metavar="N",
        help="seed of everything that is drawn (default: the file's; 0 draws a fresh one)",
    )
    parser.add_argument(
        "--robots",
        type=positive,
        metavar="N",
        help="take only the first N robots of the file",
    )
    parser.add_argument(
        "--blind", action="store_true", help="hold the virtual sensors at 0: the control experiment"
    )
    parser.add_argument(
        "--json",
        action="store_true",
        help="print the summary as one JSON object on standard output",
    )


def add_settings(parser: argparse.ArgumentParser) -> None:
    """Declares `--set`, with one value per setting."""
    parser.add_argument(
        "--set",
        type=setting,
        action="append",
        default=[],
        metavar="ELEMENT.ATTRIBUTE=VALUE",
        help="a value instead of the file's; ELEMENT is an element's name or id, a controller's"
        " library (for its parameters), 'sensor' or 'actuator' (for all virtual ones); may be"
        " given again",
    )


def add_room(parser: argparse.ArgumentParser) -> None:
    """Declares how the runs are seen, steered and kept: the control room."""
    add_web(parser)
    group = parser.add_argument_group("control room")
    group.add_argument(
        "--hold",
        action="store_true",
        help="start no run by itself, but with a key, on the page or with vsense start; after a run"
        " wait for the next one, until Ctrl-C",
    )
    group.add_argument(
        "--runs",
        type=positive,
        default=1,
        metavar="N",
        help="a series of N runs; the seed of each is the one before plus 1 (default: 1)",
    )
    group.add_argument(
        "--record", action="store_true", help="record every run to an MCAP file from its beginning"
    )
    group.add_argument(
        "--record-images",
        action="store_true",
        help="recordings hold the cameras' pictures, too, unchanged: for vsense replay --retrack",
    )


def add_web(parser: argparse.ArgumentParser, default: tuple[str, int] | None = None) -> None:
    """Declares the page; without a default there is none unless it is wanted."""
    group = parser.add_argument_group("page")
    group.add_argument(
        "--web",
        type=address,
        default=default,
        metavar="[ADDRESS:]PORT",
        help="serve the control room's page there: 8080 is this machine only; 0.0.0.0:8080 is every"
        " interface, and needs one token for looking and another for control, which are printed"
        + (f" (default: {default[1]})" if default else ""),
    )
    group.add_argument(
        "--web-tokens",
        type=Path,
        metavar="FILE",
        help="a file with the lines look=... and control=..., instead of tokens drawn anew",
    )


def address(text: str) -> tuple[str, int]:
    """An address to listen on, as [ADDRESS:]PORT."""
    host, _, number = text.rpartition(":")
    return host.strip("[]") or "127.0.0.1", port(number)


def numbers(text: str) -> tuple[int, ...]:
    """Whole numbers and ranges of them, each number once: 1-100 or 1,2,10-12."""
    found: list[int] = []
    for part in text.split(","):
        first, dash, last = part.partition("-")
        least = natural(first)
        most = natural(last) if dash else least
        if most < least or most - least >= MOST_NUMBERS:
            raise argparse.ArgumentTypeError(
                f"{part}: expected a range from low to high of at most {MOST_NUMBERS} numbers"
            )
        found += range(least, most + 1)
    if len(set(found)) < len(found):
        raise argparse.ArgumentTypeError(f"{text}: expected every number once")
    return tuple(found)


def open_experiment(
    options: argparse.Namespace, settings: Mapping[str, str] | None = None
) -> Experiment | None:
    """Loads an experiment as the command line says.

    Args:
        options: `experiment`, `duration`, `dry` and `strict`; and `set` where settings are None.
        settings: values instead of the file's.

    Returns:
        The experiment; None where the command was only asked what it holds (`--dry`): that is
        on standard output then.

    Raises:
        UsageError: there is no such experiment, or a setting fits nothing in it.
        ConfigError: the file is wrong, or is not fully supported with `--strict`.
        VsenseError: nobody reads standard output.
    """
    if settings is None:
        settings = dict(options.set)
    experiment = load(options.experiment, options.duration, settings)
    if options.dry:
        _print(describe(experiment))
    if options.strict:
        experiment.refuse_warnings()
    return None if options.dry else experiment


def choose_seed(options: argparse.Namespace, experiment: Experiment) -> int:
    """Gives a run's seed: the command line's, else the file's; for 0 a fresh one."""
    seed = experiment.seed if options.seed is None else options.seed
    return int(seed) or secrets.randbelow(2**32 - 1) + 1


def _print(text: str) -> None:
    try:
        print(text, flush=True)
    except OSError as error:
        raise VsenseError(f"standard output: {error.strerror}") from None
