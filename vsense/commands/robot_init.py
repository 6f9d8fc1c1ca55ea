"""`vsense robot init`: the roster, written and extended from what can be found."""

from __future__ import annotations

import argparse
import json
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path
from typing import Any

from vsense.base.clock import host_ns
from vsense.base.errors import GrabberError, NoMorePictures, UsageError, VsenseError
from vsense.base.files import read_bytes
from vsense.base.terminal import Console, print_data, printable
from vsense.commands import _arguments, _first_contact, _rosters
from vsense.config import roster, tracking_session
from vsense.config.casting import free_tags
from vsense.config.roster import FILE_NAME, Roster, RosterRobot
from vsense.config.roster_fields import ROBOT_FIELDS
from vsense.robots import boards
from vsense.vision.markers.families import confusion, load_family
from vsense.vision.tracking.opening import open_tracking

FAMILY = "arrow4x4"
LOOK_NS = 3_000_000_000
"""The cameras' markers are looked at for so long."""

NEIGHBOURS = Path("/proc/net/arp")
_COMPLETE = "0x2"
"""A neighbour whose hardware address is known. Source: Linux, ATF_COM."""
_MOST = 256

_ASK = 'cat "${VSENSED_ROOT:-}/etc/vsensed.conf" 2>/dev/null; true'
_KNOWN = ("tag", "name", "uid", "base")
"""Settings of a board's vsensed that are the roster's, too."""

HEAD = """\
# The lab's robots: vsense docs robot, "The roster". Robots play in this order where an experiment
# has no tags of its own. `vsense robot init` adds robots; all else in this file is yours.
"""


@dataclass(frozen=True, slots=True)
class AskedBoard:
    """A board that was asked.

    Attributes:
        host: as ssh is told.
        answers: it did.
        settings: of its vsensed, by the roster's names.
        trouble: why it did not answer, and what helps.
    """

    host: str
    answers: bool = True
    settings: Mapping[str, Any] = field(default_factory=dict)
    trouble: str = ""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the action's arguments."""
    parser.add_argument(
        "hosts",
        nargs="*",
        type=hosts,
        metavar="HOST",
        help="boards, such as root@192.168.1.30-34 or pi@robot7: each is asked by ssh for the"
        " settings that it has, and written in also where it does not answer (default: of this"
        " machine's neighbours on the network, those that answer as root)",
    )
    text = "the roster has N robots then, also without as many boards: hosts can be added later"
    _arguments.option(parser, "--robots", _arguments.positive, "N", text)
    text = "add one robot of this name, with HOST where it is given"
    _arguments.option(parser, "--add", str, "NAME", text)
    _first_contact.add_arguments(parser)
    text = (
        "look with these cameras for 3 s (two files of `vsense camera track`): robots get the"
        " tags of markers that are seen first, so put the robots that are new below them"
    )
    _arguments.session_files(parser, "--tracking", text)
    text = f"of the markers: other robots get those of its tags that stay apart (default: {FAMILY})"
    _arguments.option(parser, "--family", str, "NAME", text, FAMILY)
    text = "what turns the new robots' wheels, as vsensed --base, such as argos:/dev/ttyS0"
    _arguments.option(parser, "--base", str, "BASE", text)
    _rosters.add_roster(
        parser, "the file that is written or extended", f"(default: {FILE_NAME} here)"
    )
    _arguments.flag(parser, "--json", "print the new robots as JSON")


def hosts(text: str) -> list[str]:
    """Hosts of ssh; the last number of an address may be a range."""
    match = re.fullmatch(r"(.*\.)(\d{1,3})-(\d{1,3})", text)
    names = [text]
    if match is not None:
        first, last = int(match[2]), int(match[3])
        if not first <= last <= 255:
            raise argparse.ArgumentTypeError(f"'{text}': expected a range such as 10.0.0.30-34")
        names = [f"{match[1]}{number}" for number in range(first, last + 1)]
    try:
        return [str(ROBOT_FIELDS["host"](name)) for name in names]
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"'{text}': expected {error}") from None


def run(options: argparse.Namespace) -> int:
    """Writes or extends the roster; 0, or 1 where nothing could be added.

    Raises:
        UsageError: there is nothing to add, or no marker is left.
        ConfigError: the roster is wrong, or would be.
        VsenseError: the cameras give no picture.
    """
    path: Path = options.roster or Path(FILE_NAME)
    known, console = roster.read_known(path), Console()
    taken = {robot.tag for robot in known}
    family = options.family
    options = _first_contact.complete(options, lambda: next(_free([], family, taken, 1)))
    asked = [host for group in options.hosts for host in group]
    if options.add is not None and (len(asked) > 1 or options.robots is not None):
        raise UsageError("--add adds one robot: expected one HOST at most, and no --robots")
    found = _boards(asked, options, known, console)
    filled = _filled(found, known, options)
    new_boards = [board for board in found if board.host not in filled]
    more = (options.robots or 0) - len(known)
    count = max(len(new_boards), more, int(options.add is not None and not asked))
    if not count and not filled:
        console.say(_nothing(path, len(known), options))
        return int(not known)
    new_boards += [AskedBoard("")] * (count - len(new_boards))
    new = _robots(new_boards, options, [robot.tag for robot in known], console)
    if filled:
        changes = {tag: values for _, (tag, values) in filled.items()}
        roster.update(path, changes)
    after = roster.extend(path, new, HEAD) if new else roster.read(path)
    _say(path, after, [*(tag for tag, _ in filled.values())], new, options, console)
    if options.add is not None:
        return _first_contact.try_robot(after, new[0]["tag"], options, console)
    return 0


def _say(
    path: Path,
    after: Roster,
    filled: Sequence[int],
    new: Sequence[Mapping[str, Any]],
    options: argparse.Namespace,
    console: Console,
) -> None:
    """Says what has become of the roster, and what comes next."""
    facts = {"roster": str(path), "new": new, "filled": filled, "tags": after.tags}
    words = [f"{len(after.tags)} robots"]
    words += [f"{len(new)} new: {' '.join(str(robot['tag']) for robot in new)}"] if new else []
    words += [f"{len(filled)} have a host now: {' '.join(map(str, filled))}"] if filled else []
    print_data(json.dumps(facts, indent=2) if options.json else f"{path}: {', '.join(words)}")
    if text := confusion(load_family(options.family), after.tags):
        console.say(f"vsense: {text}", "warning")
    for line in _next(path, after, new, options):
        console.say(line)


def _filled(
    found: Sequence[AskedBoard], known: Sequence[RosterRobot], options: argparse.Namespace
) -> dict[str, tuple[int, dict[str, Any]]]:
    """By host, which robot of the roster that has no host is on a board, and what is new of it.

    A board that tells a tag is that robot; the others are the first ones.
    """
    open_tags = [robot.tag for robot in known if not robot.host]
    told = {board.settings.get("tag") for board in found}
    free = iter([tag for tag in open_tags if tag not in told])
    filled = {}
    for board in found if options.add is None else ():
        own = board.settings.get("tag")
        tag = next(free, None) if own is None else own if own in open_tags else None
        if tag is not None:
            more = {name: value for name, value in board.settings.items() if name != "tag"}
            base = {} if options.base is None else {"base": options.base}
            filled[board.host] = tag, {"host": board.host, **more, **base}
    return filled


def _nothing(path: Path, known: int, options: argparse.Namespace) -> str:
    has = f"{path} has {known} robots" if known else "nothing is written"
    if options.robots is not None:
        return f"{has}: --robots {options.robots} asks for no more"
    return (
        f"{has}: no other board on this network answers ssh as root; name boards"
        " (vsense robot init root@192.168.1.30-34), or only count robots: --robots 4"
    )


def _boards(
    asked: Sequence[str],
    options: argparse.Namespace,
    known: Sequence[RosterRobot],
    console: Console,
) -> list[AskedBoard]:
    """The new boards: those that are named, or, where nothing is, those that answer."""
    given = bool(asked) or options.robots is not None or options.add is not None
    named = list(asked) if given else [f"root@{address}" for address in neighbours()]
    hosts_known = {robot.host for robot in known}
    for host in asked:
        if host in hosts_known:
            console.say(f"{host} is in the roster already")
    there = ask([host for host in dict.fromkeys(named) if host not in hosts_known])
    if given:
        for board in there:
            if not board.answers:
                words = "does not answer, and is written in unasked"
                console.say(f"{board.host} {words}: {board.trouble}", "warning")
    taken = {
        name: {value: robot.host for robot in known if (value := getattr(robot, name))}
        for name in ("tag", "uid", "name")
    }
    return [_checked(board, taken, console) for board in there if given or board.answers]


def _checked(
    board: AskedBoard, taken: Mapping[str, dict[Any, str]], console: Console
) -> AskedBoard:
    """A board without what the roster cannot hold of its settings, which is said.

    `taken` has who has a tag, a uid, a name; the board's are added.
    """
    settings: dict[str, Any] = {}
    for name, value in board.settings.items():
        expected = _unusable(name, value)
        other = taken.get(name, {}).get(value, "") if not expected else ""
        if expected or other:
            why = f"expected {expected}" if expected else f"{other} has it, too"
            shown = printable(str(value))[:60]
            console.say(f"{board.host}: its {name} is left out, {shown!r}: {why}", "warning")
            continue
        settings[name] = value
        if name in taken:
            taken[name][value] = board.host
    return replace(board, settings=settings)


def _unusable(name: str, value: Any) -> str:
    """What a setting was expected to be; "": the roster can hold it."""
    if not str(value).isprintable():
        return "text without control characters"
    try:
        ROBOT_FIELDS[name](value)
    except ValueError as error:
        return str(error)
    return ""


def neighbours() -> list[str]:
    """The addresses that this machine has talked to on its own networks, at most 256."""
    if not os.path.exists(NEIGHBOURS):
        return []
    rows = [line.split() for line in read_bytes(NEIGHBOURS).decode().splitlines()[1:]]
    return [row[0] for row in rows if len(row) > 2 and row[2] == _COMPLETE][:_MOST]


def ask(
    names: Sequence[str], call: Callable[[Sequence[str]], tuple[int, str]] = boards.call
) -> list[AskedBoard]:
    """Asks boards at once for the settings of their vsensed."""
    answers = boards.call_all([boards.ssh_command(host, (), _ASK) for host in names], call)
    return [_board(host, code, said) for host, (code, said) in zip(names, answers)]


def _board(host: str, code: int, said: str) -> AskedBoard:
    if code:
        lines = said.splitlines()
        why = boards.ssh_advice(host, lines) or (lines[-1] if lines else "no answer")
        return AskedBoard(host, False, trouble=why)
    pairs = (line.partition("=") for line in said.splitlines() if not line.startswith("#"))
    settings: dict[str, Any] = {}
    for name, value in ((name.strip(), value.strip()) for name, _, value in pairs):
        if name in _KNOWN and value:
            is_number = name == "tag" and value.isascii() and value.isdecimal() and len(value) < 6
            settings[name] = int(value) if is_number else value
    return AskedBoard(host, settings=settings)


def _robots(
    found: Sequence[AskedBoard], options: argparse.Namespace, known: Sequence[int], console: Console
) -> list[dict[str, Any]]:
    """The new robots' values, by the roster's names."""
    has = [board.settings["tag"] for board in found if "tag" in board.settings]
    seen = [] if options.tracking is None else _seen(options.tracking, console)
    free = _free(seen, options.family, {*known, *has}, len(found))
    new = []
    for board in found:
        told = board.settings.get("tag") if options.tag is None else options.tag
        values: dict[str, Any] = {"tag": told}
        if values["tag"] is None:
            values["tag"] = next(free)
        values |= {"name": options.add} if options.add is not None else {}
        values |= {"host": board.host} if board.host else {}
        values |= {"base": options.base} if options.base is not None else {}
        values |= {"model": options.model} if options.model is not None else {}
        new.append(values | {k: v for k, v in board.settings.items() if k not in values})
    return new


def _free(seen: Sequence[int], family: str, taken: set[int], count: int) -> Iterator[int]:
    """Tags that nobody has: those that are seen first, then those that stay apart, then any.

    Raises:
        UsageError: the family has not so many.
    """
    known = load_family(family)
    wanted = count + len(taken) + len(seen)
    if wanted > known.tags:
        raise UsageError(f"{wanted} robots: the family {family} has {known.tags} markers")
    return chain(
        (tag for tag in seen if tag not in taken), free_tags(family, count, {*taken, *seen})
    )


def _seen(files: tuple[str, str], console: Console) -> list[int]:
    """The tags that cameras see within some seconds."""
    session, tags, states = tracking_session.load(*files), set[int](), 0
    with closing(open_tracking(session, host_ns, console.say)) as tracking:
        end_ns = host_ns() + LOOK_NS
        while host_ns() < end_ns:
            try:
                state, _ = tracking.next(1.0)
            except NoMorePictures:
                break
            except GrabberError as error:
                console.say(str(error), "warning")
                continue
            states += 1
            tags |= {int(pose["tag"]) for pose in state.robots if pose["seen"]}
            console.progress(f"looking for markers: {len(tags)} seen")
    console.end_progress()
    if not states:
        raise VsenseError(f"{files[0]}: no camera gave a picture; nothing is written")
    console.say(f"the cameras see {' '.join(map(str, sorted(tags))) or 'no marker'}")
    return sorted(tags)


def _next(
    path: Path, after: Roster, new: Sequence[Mapping[str, Any]], options: argparse.Namespace
) -> list[str]:
    """What comes next."""
    lines = [f"their markers: vsense camera markers --roster {path} -o markers.pdf"]
    if not all(robot.host or robot.is_driven_here for robot in after.robots):
        lines.append("how robots are reached, when there are some: vsense robot init root@ADDRESS")
    if options.tracking is not None and len(new) > 1:
        lines.append(
            "which robot wears which marker: vsense robot check EXPERIMENT --wiggle"
            f" --roster {path}"
        )
    return lines
