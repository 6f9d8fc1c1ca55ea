"""`vsense control`: orders and questions to a running experiment."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from vsense.base.errors import UsageError
from vsense.base.terminal import Console, aligned, print_data
from vsense.commands import COMMANDS, _arguments
from vsense.monitor.ui import control_client
from vsense.monitor.ui.control_client import Answered

DESCRIPTION = (
    "Talks to the `vsense run` or `vsense lab` that this user, or another member of its lab (see"
    " `vsense share`), runs on this machine, or, where there is none, to its `vsense camera track`."
    " Orders from here, from its keyboard and from the page are the same, and all see them."
)
HANDOVER = (
    "Robots belong to one `vsense run` at a time, also between its runs. This ends the run that has"
    " them, in order: robots stop, recordings and figures are completed; then it waits until they"
    " are free. A run that is going on ends with --force only. Members of a lab hand over each"
    " other's (see `vsense share`). Without robots: all that one run has."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the arguments of all seven."""
    name = parser.prog.split()[-1]
    text = COMMANDS[f"control {name}"][1]
    parser.description = f"{text[:1].upper()}{text[1:]}. {DESCRIPTION}"
    if name == "replace":
        parser.add_argument(
            "pair",
            type=_tag_pair,
            metavar="TAG=TAG",
            help="23=37: robot 37 takes the role of 23 from the next run on, with its controller,"
            " start and name; refused while a run goes on",
        )
    if name == "handover":
        parser.description = HANDOVER
        parser.add_argument(
            "robots",
            nargs="*",
            type=_arguments.natural,
            metavar="TAG",
            help="the robots that are wanted",
        )
    add_process(parser)
    if name == "handover":
        _arguments.flag(parser, "--force", "end a run that is going on, too; its wheels stop")
        _arguments.flag(parser, "--list", "only say which run has which robots")
    _arguments.flag(parser, "--json", "print the answer as one JSON object")
    if name == "stop":
        text = (
            "stop all robots now, whatever the run is doing, of all experiments that this user runs"
            " here; only a reset ends it"
        )
        _arguments.flag(parser, "--emergency", text)
        text = "stop every experiment on this machine that this user runs, or a member of its lab"
        _arguments.flag(parser, "--all", text)


def _tag_pair(text: str) -> tuple[int, int]:
    from vsense.commands._rosters import tag_pair  # which a stop must not wait for

    return tag_pair(text)


def add_process(parser: argparse.ArgumentParser) -> None:
    """Declares which experiment is meant."""
    text = "its process number, where several run"
    _arguments.option(parser, "--process", _arguments.process, "PID", text)


def run(options: argparse.Namespace) -> int:
    """Asks the running experiment, or gives it an order."""
    if options.command == "handover":
        return _hand_over(options)
    if options.command == "status":
        answer = control_client.ask({"ask": "status"}, options.process)
        print_data(json.dumps(answer, indent=2) if options.json else table(answer))
        return 0
    kind = "emergency" if getattr(options, "emergency", False) else options.command
    order: dict[str, Any] = {"order": kind, "by": "terminal"}
    if options.command == "replace":
        order["pair"] = list(options.pair)
    if getattr(options, "all", False):
        return _order_all(order, options)
    own = control_client.order_own(order) if kind == "emergency" and options.process is None else []
    if len(own) > 1 or any("error" in answer for _, answer in own):
        return _answered(own, options)
    if own:
        _print_answer(own[0][1], options)
        return 0
    _print_answer(control_client.ask(order, options.process), options)
    return 0


def _print_answer(answer: Mapping[str, Any], options: argparse.Namespace) -> None:
    print_data(json.dumps(answer) if options.json else control_client.text_of(answer))


def _order_all(order: Mapping[str, Any], options: argparse.Namespace) -> int:
    """Gives an order to all experiments at once.

    1 where one does not answer, or refuses, and where there may be some that are not reached.
    """
    if options.process is not None:
        raise UsageError("--all and --process: one or the other")
    answered, reasons = control_client.order_all(order)
    for reason in reasons:
        Console().say(f"vsense: runs of others were not reached: {reason}", "trouble")
    return int(_answered(answered, options) or bool(reasons))


def _answered(answered: Iterable[Answered], options: argparse.Namespace) -> int:
    """Prints what several experiments answered; 1 where one does not, or refuses."""
    if options.json:
        print_data(json.dumps({words[0]: answer for words, answer in answered}))
    else:
        rows = [(*words[:4], _became(answer)) for words, answer in answered]
        print_data("\n".join(aligned(rows)))
    return int(any("error" in answer and not _is_idle(answer) for _, answer in answered))


def _became(answer: Mapping[str, Any]) -> str:
    """What became of a stop."""
    if "error" not in answer:
        return str(answer["text"])
    return f"{'nothing to stop' if _is_idle(answer) else 'NOT STOPPED'}: {answer['error']}"


def _is_idle(answer: Mapping[str, Any]) -> bool:
    """Whether a run refuses a stop because nothing of it moves."""
    return str(answer["error"]).startswith("cannot stop: ")


def robots(options: argparse.Namespace) -> int:
    """Shows the robots of the running experiment."""
    answer = control_client.ask({"ask": "status"}, options.process)
    rows = answer["robots"]
    shown = seen_table if answer["command"] == "track" else robot_table
    print_data(json.dumps(rows, indent=2) if options.json else shown(rows))
    return 0


def _hand_over(options: argparse.Namespace) -> int:
    """Has robots handed over, and waits until they are."""
    if options.list:
        held = control_client.held_robots()
        rows = {str(tag): str(lease) for tag, lease in held.items()}
        print_data(
            json.dumps(rows, indent=2) if options.json else control_client.holders_text(held)
        )
        return 0
    free, processes = control_client.hand_over(
        options.robots, options.process, options.force, Console()
    )
    freed: dict[str, Any] = {"free": free, "processes": processes}
    print_data(json.dumps(freed) if options.json else f"{control_client.robots_are(free)} free")
    return 0


def table(answer: Mapping[str, Any]) -> str:
    """The state of the run and its robots for a person."""
    now, rows = answer["run"], answer["robots"]
    length = "" if now["length_s"] is None else f" of {now['length_s']:g}"
    late = f", {now['late']} late" if now["late"] else ""
    latency = now["latency_ms"]
    sent = "" if latency is None else f", capture to sent {latency['p50']:.0f} ms"
    silent = f"\nno arena state for {now['silent_s']:.1f} s" if now["silent_s"] else ""
    which = _of_series(answer["series"]) if "series" in answer else f"run {now['run']}"
    head = f"{answer['name']}{control_client.whose(answer)}: {which} is {now['state']}"
    return (
        f"{head}, {now['time_s']:.1f}{length} s, timestep {now['timestep']}{late};"
        f" {now['rate_hz']:.1f} Hz{sent}{silent}{_recorded(now)}\n\n"
        f"{seen_table(rows) if answer['command'] == 'track' else robot_table(rows)}"
    )


def _of_series(run: Mapping[str, Any]) -> str:
    """Which run of a series by plan it is."""
    attempt = f", attempt {run['attempt']}" if run["attempt"] > 1 else ""
    return (
        f"run {run['number']} of {run['of']} of the series {run['name']} ({run['condition']},"
        f" start {run['start']}, repetition {run['repetition']}{attempt})"
    )


def _recorded(now: Mapping[str, Any]) -> str:
    """Where the run is recorded, if it is."""
    recording = now.get("recording") or {}
    trouble = f"\nrecording in trouble: {recording['trouble']}" if recording.get("trouble") else ""
    if not recording.get("on"):
        return trouble
    return f"\nrecording to {recording['file']}, {recording['bytes'] / 1e6:.1f} MB{trouble}"


def seen_table(rows: Mapping[str, list[Any]]) -> str:
    """A line for each robot that is only tracked."""
    columns = zip(*(rows[name] for name in ("tag", "x_m", "y_m", "yaw_rad", "seen")), strict=True)
    lines = [
        (str(tag), f"{x_m:.3f}", f"{y_m:.3f}", f"{yaw_rad:.2f}", "yes" if seen else "lost")
        for tag, x_m, y_m, yaw_rad, seen in columns
    ]
    return "\n".join(aligned([("tag", "x [m]", "y [m]", "yaw [rad]", "seen"), *lines]))


_SHOWN = 6
"""Robots that are named where many are alike."""


def robot_table(rows: Mapping[str, list[Any]]) -> str:
    """A line for each robot."""
    head = (
        *("robot", "tag", "software", "controller", "link", "signal", "pose", "battery"),
        *("base errors", ""),
    )
    robots = by_robot(rows)
    mixed = len(set(rows["expected"])) > 1
    lines = aligned([head, *(_cells(robot, mixed) for robot in robots)])
    return "\n".join([*lines, *mixed_daemons(dict(zip(rows["name"], robots)))])


def by_robot(columns: Mapping[str, Sequence[Any]]) -> list[dict[str, Any]]:
    """The robots of `/robots`, a row each."""
    return [dict(zip(columns, values)) for values in zip(*columns.values())]


def mixed_daemons(robots: Mapping[str, Mapping[str, Any]]) -> Iterator[str]:
    """Says where robots run different vsensed, or different sources of one controller.

    `robots` have, by name, "version", "controller" and "hash" of what they say that they run.
    """
    kinds: dict[str, dict[str, list[str]]] = {}
    for name, row in robots.items():
        for what, which in (
            ("vsensed", row.get("version")),
            (row.get("controller"), row.get("hash")),
        ):
            if what and which:
                kinds.setdefault(what, {}).setdefault(which, []).append(name)
    for what, names in kinds.items():
        if len(names) > 1:
            words = "; ".join(
                f"{which} on {', '.join(those[:_SHOWN])}{' ...' * (len(those) > _SHOWN)}"
                for which, those in names.items()
            )
            yield f"mixed daemons: {what} {words}: vsense robot deploy brings all the same"


def _cells(robot: Mapping[str, Any], mixed: bool) -> tuple[str, ...]:
    """A robot's line; in a mixed swarm with the controller that the experiment has for it."""
    runs = " ".join(filter(None, (robot["controller"], robot["hash"]))) or "-"
    battery_mv = robot["battery_mv"]
    battery = {True: "low", False: "ok", None: "-"}[robot["battery_low"]]
    return (
        robot["name"],
        str(robot["tag"]),
        robot["version"] or "-",
        f"{robot['expected']}: {runs}" if mixed else runs,
        _age(robot["heard_ms"]) if robot["connected"] else "lost" if robot["sessions"] else "never",
        "-" if robot.get("signal_dbm") is None else f"{robot['signal_dbm']} dBm",
        _age(robot["pose_age_ms"]),
        f"{battery_mv / 1e3:.2f} V" if battery_mv else battery,
        "-" if robot["base_errors"] is None else str(robot["base_errors"]),
        f"{robot['trouble'] or robot['state']}"
        f"{', power saving is on' if robot.get('power_saving') else ''}"
        f"{', not authenticated' if robot['authenticated'] is False else ''}",
    )


def _age(milliseconds: float | None) -> str:
    return "-" if milliseconds is None else f"{milliseconds:.0f} ms"
