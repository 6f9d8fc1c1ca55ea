"""What `vsense sim`, `vsense lab` and `vsense run` share: their options, and how they begin.

What only the last two need, robots' links and the control room, is imported where they ask for it.
"""

from __future__ import annotations

import argparse
import json
import secrets
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vsense.base.errors import UsageError
from vsense.base.terminal import Console, print_data
from vsense.commands import arguments, homes, rosters
from vsense.config.description import as_json, describe
from vsense.config.experiment import first_robots, load
from vsense.config.placement import settle
from vsense.config.specs import Experiment, Stage
from vsense.run import asked
from vsense.run import directory as run_directory

if TYPE_CHECKING:
    from vsense.monitor.ui.room import RoomOptions
    from vsense.robots.link.keys import LinkTrust
    from vsense.robots.link.server import VirtualSensorServer
    from vsense.run.leases import RobotLeases


def add_experiment(parser: argparse.ArgumentParser, stage: Stage) -> None:
    """Declares what all commands that run an experiment have in common."""
    arguments.add_experiment_name(parser)
    text = (
        "only say what the experiment holds, what of its file is not supported, and how many"
        " bytes a robot is sent and sends"
    )
    arguments.flag(parser, "--dry", text)
    arguments.flag(
        parser, "--strict", "refuse a file in which anything is not supported, instead of warning"
    )
    text = (
        "go on where a controller asks for a sensor or actuator that nobody offers, or is told a"
        " parameter that it does not read or that is no number: it is only said"
    )
    arguments.flag(parser, "--lenient", text)
    arguments.add_code(parser)
    _add_run(parser)
    # Real robots are those of the lab; what is made up here goes on where the lab has too few.
    rosters.add_casting(parser, rosters.HERE if stage is Stage.RUN else "")


def _add_run(parser: argparse.ArgumentParser) -> None:
    arguments.option(
        parser, "--duration", arguments.seconds, "S", "length of a run in s (default: the file's)"
    )
    text = "seed of everything that is drawn (default: the file's; 0 draws a fresh one)"
    arguments.option(parser, "--seed", arguments.natural, "N", text)
    arguments.option(
        parser, "--robots", arguments.positive, "N", "take only the first N robots of the file"
    )
    arguments.flag(parser, "--blind", "hold the virtual sensors at 0: the control experiment")
    arguments.flag(parser, "--json", "print the summary, or what --dry says, as one JSON object")


def add_settings(parser: argparse.ArgumentParser) -> None:
    """Declares `--set`, with one value per setting."""
    parser.add_argument(
        "--set",
        type=arguments.setting,
        action="append",
        default=[],
        metavar="ELEMENT.ATTRIBUTE=VALUE",
        help="a value instead of the file's; ELEMENT is an element's name or id, a controller's"
        " library (for its parameters), 'sensor' or 'actuator' (for all virtual ones); may be"
        " given again",
    )


def add_trust(parser: argparse.ArgumentParser) -> None:
    """Declares which robots are believed."""
    add_key(parser)
    add_insecure(
        parser, "take robots that have no key, too: whoever reaches the port can drive robots"
    )


def add_key(parser: argparse.ArgumentParser) -> None:
    """Declares where the swarm's keys are."""
    text = (
        "the swarm's keys, which 'vsense robot keys' makes (default: vsense/swarm.key in"
        " ~/.config or $XDG_CONFIG_HOME)"
    )
    arguments.option(parser, "--key", Path, "FILE", text)


def key_path(options: argparse.Namespace) -> Path:
    """Where the swarm's keys are."""
    from vsense.robots.link import keys

    return options.key or keys.default_path()


def add_insecure(parser: argparse.ArgumentParser, text: str, page: bool = True) -> None:
    """Declares `--insecure`, with `page` that of a page, too."""
    arguments.flag(parser, "--insecure", f"{text}; {arguments.INSECURE_PAGE}" if page else text)


def trust_of(options: argparse.Namespace) -> LinkTrust:
    """Returns what `add_trust` declares.

    Raises:
        UsageError: there are no keys, and robots without one are not to be taken.
        VsenseError: the keys cannot be used.
    """
    from vsense.robots import key_holders
    from vsense.robots.link import keys

    path = key_path(options)
    if options.key is None and not path.exists():
        if options.insecure:
            return keys.INSECURE
        raise UsageError(
            f"no swarm key ({path}): 'vsense robot keys --new-key' makes it, 'vsense robot deploy'"
            " brings each robot its own; or go on without keys: --insecure"
        )
    return key_holders.trust(key_holders.file_of(path), keys.read(path), options.insecure)


def say_trust(trust: LinkTrust, say: Callable[[str], None]) -> None:
    """Says where anybody could be a robot, and which former keys are still believed."""
    for note in trust.notes:
        say(note)
    if trust.insecure:
        say("--insecure: robots without a key are taken; whoever reaches the port can drive them")


def add_legacy_port(parser: argparse.ArgumentParser) -> None:
    """Declares the port for robots with the original's client."""
    text = (
        "serve robots that still run the original's client, too, on this TCP port; 0 takes a free"
        " one (default: serve none)"
    )
    arguments.option(parser, "--legacy-port", arguments.port, "P", text)


def check_legacy_port(options: argparse.Namespace, port: int) -> None:
    """Raises UsageError where the port of `add_legacy_port` is that for `vsensed`, too."""
    if options.legacy_port and options.legacy_port == port:
        raise UsageError(
            f"--legacy-port: {port} is the port for vsensed, too: give that another, such as"
            f" --port {port + 1}"
        )


def say_legacy_port(server: VirtualSensorServer, say: Callable[[str], None]) -> None:
    """Says where robots with the original's client connect to, and what they do not get."""
    from vsense.robots.link.legacy.server import MixedServer

    if isinstance(server, MixedServer):
        say(f"and with the original client on port {server.legacy_port}")
        for name in server.unknown:
            say(f"the original client does not know the sensor '{name}': not told to it")


def say_doubts(doubts: Sequence[str], console: Console) -> None:
    """Says how other machines could move robots without showing who they are."""
    for doubt in doubts:
        console.say(f"not authenticated: {doubt}", "warning")


def add_room(parser: argparse.ArgumentParser) -> None:
    """Declares how the runs are seen, steered and kept: the control room."""
    arguments.add_web(parser, insecure=False)
    arguments.add_foxglove(parser)
    group = arguments.add_hold(
        parser,
        "start no run by itself, but with a key, on the page or with vsense start; after a run"
        " wait for the next one, until Ctrl-C",
    )
    text = "a series of N runs; the seed of each is the one before plus 1 (default: 1)"
    arguments.option(group, "--runs", arguments.positive, "N", text, 1)
    homes.add_home(group)
    arguments.add_locked(group)
    arguments.add_recording(group)


def room_of(options: argparse.Namespace) -> RoomOptions:
    """Returns what `add_room` declares."""
    from vsense.monitor.ui.room import RoomOptions

    doors = {"web": arguments.web_of(options), "foxglove": arguments.foxglove_of(options)}
    return arguments.fill(RoomOptions, options, **doors, series=None, tokens=None)


def lease_robots(
    options: argparse.Namespace, experiment: Experiment, host: str
) -> AbstractContextManager[RobotLeases | None]:
    """Takes an experiment's real robots, before any hears of it; a context with their leases.

    Those that are on this machine, where nobody else's can connect, are emulated: any run may have
    its own of them, and there are no leases.

    Args:
        options: of the command that wants them; it may take the first few only (`--robots`).
        experiment: whose robots.
        host: where they connect to.

    Raises:
        LeasedError: another run has some of them.
        SharingError: this account may not use the lab's robots, or its folder is not safe.
        ControlSocketError: likewise this account's own folder.
    """
    taken = first_robots(experiment, options.robots)
    tags = [robot.tag for robot in taken.robots]
    return lease_tags(options, experiment.name, tags, host)


def lease_tags(
    options: argparse.Namespace, name: str, tags: Iterable[int], host: str
) -> AbstractContextManager[RobotLeases | None]:
    """As `lease_robots`, of the robots with these tags, for the experiment of that name."""
    from vsense.monitor.ui.access import is_loopback
    from vsense.run.leases import RobotLeases

    if is_loopback(host):
        return nullcontext()
    leases = RobotLeases(lease_folder(), options.command, name)
    leases.take(tags)
    return leases


def lease_folder() -> Path:
    """Where all runs look that may want the same robots: the lab's folder, else the user's own."""
    from vsense.base import sharing
    from vsense.monitor.ui.control_socket import folder

    lab = sharing.lab()
    return folder() if lab is None else lab.path


def check_doors(options: argparse.Namespace, host: str, port: int) -> None:
    """Refuses what page, recordings and ports lack, before anything is made or started.

    Args:
        host, port: where the robots connect to.

    Raises:
        UsageError: a library is missing, or two are to have one port.
        VsenseError: the page's files cannot be used, or another program has a port.
    """
    from vsense.monitor import recording
    from vsense.monitor.ui.foxglove_server import check_foxglove
    from vsense.monitor.ui.watchers import page_access
    from vsense.robots.link import network

    check_legacy_port(options, port)
    if options.record or options.record_images:
        recording.require()
    web = arguments.web_of(options)
    ports = (port, options.legacy_port, None if web is None else web.port)
    check_foxglove(arguments.foxglove_of(options), ports)
    with ExitStack() as stack:
        robots = network.bind(host, port)
        stack.callback(robots.tcp.close)
        stack.callback(robots.udp.close)
        if options.legacy_port:
            stack.callback(network.listen(host, options.legacy_port)[0].close)
        if web is None:
            return
        page_access(web)
        if web.port and web.port in (port, options.legacy_port):
            raise UsageError(
                f"--web: {web.port} is a port for robots, too: give the page another, such as"
                f" --web {web.port + 1}"
            )
        stack.callback(network.listen(web.host, web.port)[0].close)


def open_experiment(
    options: argparse.Namespace,
    settings: Mapping[str, str] | None = None,
    stage: Stage = Stage.RUN,
) -> Experiment | None:
    """Loads an experiment for a stage; `settings` are by default those of `--set`.

    Returns:
        The experiment; None with `--dry`, which prints its contents on standard output.

    Raises:
        UsageError: there is no such experiment, or a setting fits nothing in it.
        ConfigError: the file is wrong, or is not fully supported with `--strict`; or a controller
            asks for what nobody offers, or is told what it does not read, without `--lenient`.
        VsenseError: standard output cannot be written.
    """
    if settings is None:
        settings = dict(options.set)
    virtual, code = getattr(options, "virtual_devices", False), arguments.code_of(options)
    how = options.duration, settings, stage, virtual, code
    experiment = load(options.experiment, *how, rosters.casting_of(options, stage is Stage.RUN))
    if options.dry:
        told = json.dumps(as_json(experiment), indent=2) if options.json else describe(experiment)
        print_data(told)
    if options.strict:
        experiment.refuse_warnings()
    if options.dry:
        return None
    if not options.lenient:
        asked.check(experiment)
    return experiment


def say_warnings(console: Console, experiment: Experiment) -> None:
    """Says what of the experiment's file is not supported, and who plays for whom."""
    for warning in experiment.warnings:
        console.say(f"vsense: {warning}")
    rosters.say_casting(experiment, console.say)


def prepare(
    options: argparse.Namespace, experiment: Experiment, real: bool = True
) -> tuple[Experiment, int, Path]:
    """Takes the robots that are wanted and settles their places; for `real` see `settle`.

    Returns:
        The experiment, the seed of its first run, and the new directory of all runs.

    Raises:
        UsageError: there are not so many robots.
        ConfigError: there is no place for all.
        DirectoryError: the directory cannot be made, or is not empty.
    """
    experiment, seed = first_robots(experiment, options.robots), choose_seed(options, experiment)
    experiment = settle(experiment, seed, real)
    return experiment, seed, run_directory.make(options.output, experiment.name, seed)


def made_of(options: argparse.Namespace, experiment: Experiment, seed: int) -> dict[str, Any]:
    """How `open_experiment` and `prepare` have made an experiment, for recordings."""
    code = arguments.code_of(options).absolute(Path.cwd())
    return {
        "path": str(experiment.path.absolute()),
        "stage": experiment.stage.value,
        "length_s": options.duration,
        "settings": dict(options.set),
        "virtual_devices": bool(getattr(options, "virtual_devices", False)),
        "robots": options.robots,
        "seed": seed,
        "code": {"sources": dict(code.sources), "includes": list(code.includes)},
    }


def choose_seed(options: argparse.Namespace, experiment: Experiment) -> int:
    """Gives a run's seed: the command line's, else the file's; for 0 a fresh one."""
    seed = experiment.seed if options.seed is None else options.seed
    return int(seed) or secrets.randbelow(2**32 - 1) + 1
