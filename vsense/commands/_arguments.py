"""Types of command line arguments, each of which refuses with what was expected, and the options
that several commands share."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, TypeVar

from vsense.base.errors import UsageError
from vsense.robots.sources import CodeOptions

if TYPE_CHECKING:
    from vsense.monitor.ui.access import WebAddress

Options = TypeVar("Options")
Kind = Callable[[str], object]
"""What reads an argument's value."""

MOST_NUMBERS = 100_000
"""A range of numbers may have so many."""
_UNITS_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4}
_LENGTH = re.compile(r"([0-9]+(?:\.[0-9]*)?) *(mm|cm|m|in)")


def parsed(read: Callable[[str], Options]) -> Callable[[str], Options]:
    """The type of an argument that `read` reads, which raises ValueError."""

    def parse(text: str) -> Options:
        try:
            return read(text)
        except ValueError as error:
            raise argparse.ArgumentTypeError(str(error)) from None

    return parse


def number(least: float, most: float, expected: str) -> Callable[[str], float]:
    """The type of a number in a range; `expected` says which."""

    def parse(text: str) -> float:
        with suppress(ValueError):
            if least <= (value := float(text)) <= most:
                return value
        raise argparse.ArgumentTypeError(f"'{text}': expected {expected}")

    return parse


def matched(pattern: str, text: str, expected: str) -> re.Match[str]:
    """The whole of an argument's text as a pattern has it; `expected` says what that is."""
    if match := re.fullmatch(pattern, text):
        return match
    raise argparse.ArgumentTypeError(f"'{text}': expected {expected}")


def seconds(text: str) -> float:
    """A length of time in s, at least one and finite."""
    value = read_number(text, float, "a number of seconds")
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


def length_mm(text: str, units: Sequence[str] = ("mm", "cm", "in")) -> float:
    """A length with one of some units."""
    match = _LENGTH.fullmatch(text.strip())
    if match is None or match[2] not in units:
        names = " or ".join(units)
        raise argparse.ArgumentTypeError(f"'{text}': expected a length such as 70mm, in {names}")
    return float(match[1]) * _UNITS_MM[match[2]]


def length_m(text: str) -> float:
    """A length with mm, cm or m, in m."""
    return 1e-3 * length_mm(text, ("mm", "cm", "m"))


def _integer(text: str, least: int, most: int) -> int:
    value = int(read_number(text, int, "a whole number"))
    if not least <= value <= most:
        raise argparse.ArgumentTypeError(f"{text}: expected {least} to {most}")
    return value


def read_number(text: str, kind: type[int] | type[float], expected: str) -> float:
    """A number of any size; `expected` says which kind."""
    try:
        return kind(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is not {expected}") from None


def setting(text: str) -> tuple[str, str]:
    """A setting of an experiment: ELEMENT.attribute=VALUE."""
    key, equals, value = text.partition("=")
    if not equals or "." not in key.strip("."):
        raise argparse.ArgumentTypeError(
            f"'{text}' is no ELEMENT.attribute=VALUE, such as sensor.noise=0.1"
        )
    return key, value


def flag(group: Any, name: str, text: str) -> None:
    """Declares an option without a value; `text` is its help."""
    group.add_argument(name, action="store_true", help=text)


def option(
    group: Any,
    names: str,
    kind: Kind,
    metavar: str,
    text: str,
    default: object = None,
    required: bool = False,
) -> None:
    """Declares an option, of which `kind` reads the value; a space separates its `names`."""
    group.add_argument(
        *names.split(), type=kind, metavar=metavar, help=text, default=default, required=required
    )


def repeated(
    group: Any, name: str, kind: Kind, metavar: str, text: str, required: bool = False
) -> None:
    """Declares an option that may be given again: its values are a list."""
    group.add_argument(
        name, type=kind, action="append", default=[], metavar=metavar, help=text, required=required
    )


def many(group: Any, name: str, kind: Kind, metavar: str, text: str) -> None:
    """Declares an argument or an option of one value or more."""
    group.add_argument(name, nargs="+", type=kind, metavar=metavar, help=text)


def choice(
    group: Any,
    name: str,
    choices: Sequence[str],
    text: str,
    default: str | None = None,
    required: bool = False,
) -> None:
    """Declares an option that takes one of some words."""
    group.add_argument(name, choices=choices, help=text, default=default, required=required)


def session_files(group: Any, name: str, text: str, second: str = "SESSION") -> None:
    """Declares an option of the two files of a tracking session."""
    group.add_argument(name, nargs=2, metavar=("RESOURCES", second), help=text)


def add_experiment_name(parser: argparse.ArgumentParser) -> None:
    """Declares the experiment; a shell completes shipped ones and files."""
    from vsense.config.experiment import of_folder

    text = "a shipped experiment's name, the path of a .argos file, or of a folder with one"
    name = parser.add_argument("experiment", type=of_folder, help=text)

    def complete(prefix: str, **_: Any) -> list[str]:
        from argcomplete.completers import FilesCompleter

        from vsense.config.experiment import ARGOS_SUFFIX, shipped

        files = FilesCompleter(allowednames=[ARGOS_SUFFIX])(prefix)
        return [*(name for name in shipped() if name.startswith(prefix)), *files]

    # Where argcomplete looks for it.
    setattr(name, "completer", complete)  # noqa: B010
    parser.add_argument("--list", nargs=0, action=ListShipped, help="list the shipped experiments")


class ListShipped(argparse.Action):
    """`--list`: the names of the shipped experiments, one a line."""

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> NoReturn:
        """Prints them, and ends the program."""
        from vsense.config.experiment import shipped

        sys.stdout.write("".join(f"{name}\n" for name in shipped()))
        parser.exit()


def address(text: str) -> tuple[str, int]:
    """An address to listen on, as [ADDRESS:]PORT."""
    host, _, number = text.rpartition(":")
    return host.strip("[]") or "127.0.0.1", port(number)


def tracker(text: str) -> tuple[str, int]:
    """A tracker: ADDRESS:PORT, or lines[:PORT] for one that connects; ("", 0): its usual port."""
    host, colon, number = text.rpartition(":")
    if text == "lines":
        return "", 0
    if not colon or not host or not number.isdigit() or host.startswith("lines:"):
        raise argparse.ArgumentTypeError(
            f"'{text}': expected ADDRESS:PORT, or lines or lines:PORT for a tracker that connects"
        )
    return "" if host == "lines" else host.strip("[]"), port(number)


def numbers(text: str) -> tuple[int, ...]:
    """Whole numbers and ranges of them, each number once: 1-100 or 1,2,10-12."""
    result: list[int] = []
    for part in text.split(","):
        first, dash, last = part.partition("-")
        least = natural(first)
        most = natural(last) if dash else least
        if most < least or most - least >= MOST_NUMBERS:
            raise argparse.ArgumentTypeError(
                f"{part}: expected a range from low to high of at most {MOST_NUMBERS} numbers"
            )
        result += range(least, most + 1)
    if len(set(result)) < len(result):
        raise argparse.ArgumentTypeError(f"{text}: expected every number once")
    return tuple(result)


def add_link(parser: argparse.ArgumentParser, free: str = "") -> None:
    """Declares where robots connect to; `free` says which port takes a free one."""
    text = "interface that robots connect to, 0.0.0.0: all (default: the file's vss_host)"
    option(parser, "--host", str, "ADDRESS", text)
    option(parser, "--port", port, "P", f"TCP and UDP port{free} (default: the file's vss_port)")


def add_tracking_files(parser: argparse.ArgumentParser, optional: bool = False) -> None:
    """Declares the two files of a tracking session; `optional`: the second one may be left out."""
    folder = "; or the folder of a recording or a lab, which has both" if optional else ""
    parser.add_argument(
        "resources",
        help=f"the resources file (arena_tracking_system): grabbers, trackers, cameras{folder}",
    )
    text = "the experiment file (arena_tracking): what of the resources to use"
    text += " (default: all of them, each camera with the grabber of its name)" if optional else ""
    parser.add_argument("experiment", nargs="?" if optional else None, help=text)


WEB = "127.0.0.1", 8080
"""Where a page is that is wanted, nobody says where."""


def add_web(
    parser: argparse.ArgumentParser,
    default: tuple[str, int] | None = None,
    insecure: bool = True,
) -> None:
    """Declares the page; without a default there is none unless it is wanted.

    `insecure`: declares the option of this name, too, which other groups may have declared.
    """
    group = parser.add_argument_group("page")
    group.add_argument(
        "--web",
        type=address,
        nargs="?",
        const=WEB,
        default=default,
        metavar="[ADDRESS:]PORT",
        help="serve the control room's page there: 8080, where nothing is said, is this machine"
        " only; 0.0.0.0:8080 is every interface, with HTTPS, one token for looking and another for"
        " control, which are printed" + (f" (default: {default[1]})" if default else ""),
    )
    text = "a file with the lines look=... and control=..., instead of new random tokens"
    option(group, "--web-tokens", Path, "FILE", text)
    text = (
        "serve the page with HTTPS and this certificate (PEM); without it, a page that other"
        " machines may open has one that is made here and kept, whose fingerprint is printed"
    )
    option(group, "--web-cert", Path, "FILE", text)
    option(group, "--web-key", Path, "FILE", "its private key (default: in the same file)")
    if insecure:
        flag(group, "--insecure", INSECURE_PAGE)


ONE_CAMERA = "all pictures are of this camera, whatever their folders"
INSECURE_PAGE = "other machines may open the page with plain HTTP, in which tokens can be heard"


def web_of(options: argparse.Namespace) -> WebAddress | None:
    """Returns what `add_web` declares: where the page is served, None: nowhere."""
    from vsense.monitor.ui.access import WebAddress  # a stop must not wait for it

    if options.web_key is not None and options.web_cert is None:
        raise UsageError("--web-key is the key of a certificate: give that with --web-cert")
    if options.web is None:
        return None
    host, port = options.web
    files = (options.web_tokens, options.web_cert, options.web_key)
    return WebAddress(host, port, *files, options.insecure)


def add_action(actions: Any, name: str, text: str) -> argparse.ArgumentParser:
    """Adds an action's parser; `text` is its line in the help, and heads its own page of help."""
    parser: argparse.ArgumentParser = actions.add_parser(
        name, help=text, description=f"{text[:1].upper()}{text[1:]}."
    )
    return parser


def add_bases(parser: Any, bases: Sequence[str]) -> None:
    """Declares what emulated robots are based on; None: as the roster says."""
    text = (
        "what the emulated robots are based on, as in vsensed --base; mixed: one kind after"
        f" the other (default: as the roster says, and else {bases[0]})"
    )
    choice(parser, "--base", bases, text)
    text = (
        "the emulated firmware stops the wheels 400 ms after the last command, as one built"
        " with firmware_bridge/fw_watchdog.h does. By default it has no watchdog, as real firmware:"
        " both processes of a vsensed killed at once leave its wheels turning"
    )
    flag(parser, "--firmware-watchdog", text)


def fill(kind: type[Options], options: argparse.Namespace, *absent: str, **given: Any) -> Options:
    """Makes a dataclass of the options that are named as its fields, and of `given`.

    A command that has no option for a field says so: `absent` names those that keep their defaults.
    """
    names = {field.name for field in fields(kind)} - given.keys()  # type: ignore[arg-type]
    if (without := {name for name in names if name not in options}) != set(absent):
        wrong = ", ".join(sorted(without ^ set(absent)))
        raise TypeError(f"{kind.__name__}: expected an option, or no word of its absence: {wrong}")
    return kind(**{name: getattr(options, name) for name in names - without}, **given)


def add_code(parser: argparse.ArgumentParser) -> None:
    """Declares where the sources of controllers for ARGoS are."""
    group = parser.add_argument_group("code for ARGoS")
    text = (
        "the C++ files of a library for ARGoS, such as libfoo=controllers/foo/*.cpp; NAME may"
        " be a controller's label or id, too. Needed only where they are not found by themselves;"
        " may be given again"
    )
    repeated(group, "--sources", str, "NAME=FILE[,FILE...]", text)
    text = (
        "a folder of its headers; PREFIX=FOLDER for what is included as PREFIX/...; may be"
        " given again"
    )
    repeated(group, "--include", str, "FOLDER", text)


def code_of(options: argparse.Namespace) -> CodeOptions:
    """Returns what `add_code` declares; UsageError: an option has another form."""
    return CodeOptions.of(options.sources, options.include)
