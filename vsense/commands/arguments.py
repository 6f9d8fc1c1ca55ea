"""Types of command line arguments: each refuses with what was expected."""

from __future__ import annotations

import argparse


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
