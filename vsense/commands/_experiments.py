"""What `vsense sim`, `vsense lab` and `vsense run` share: their options, and how they begin.

What only the last two need, robots' links and the control room, is imported where they ask for it.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vsense.base.errors import UsageError
from vsense.base.terminal import print_data
from vsense.commands import _arguments, _rosters
from vsense.config.specs import Stage
from vsense.modes.options import ExperimentOptions
from vsense.monitor.ui.access import FoxgloveAddress

if TYPE_CHECKING:
    from vsense.monitor.ui.room import RoomOptions
    from vsense.robots.link.keys import LinkTrust

MOST_VOLTS = 10.0
DEFAULT = "foraging"
"""The experiment of links and emulated robots, where none is named."""

ROBOTS = "the file's first N robots; more than it has are added to its <distribute>"


def add_experiment(parser: argparse.ArgumentParser, stage: Stage) -> None:
    """Declares what all commands that run an experiment have in common."""
    _arguments.add_experiment_name(parser)
    text = (
        "only say what the experiment holds, what of its file is not supported, and how many"
        " bytes a robot is sent and sends; its own Python is loaded, as in a run"
    )
    _arguments.flag(parser, "--dry", text)
    _arguments.flag(
        parser, "--strict", "refuse a file in which anything is not supported, instead of warning"
    )
    text = (
        "go on where a controller asks for a sensor or actuator that is not there, or is given"
        " a parameter that it does not read or that is no number: a message says so"
    )
    _arguments.flag(parser, "--lenient", text)
    _arguments.add_code(parser)
    _add_run(parser)
    # Real robots are those of the lab; what is made up here goes on where the lab has too few.
    _rosters.add_casting(parser, _rosters.HERE if stage is Stage.RUN else "")


def _add_run(parser: argparse.ArgumentParser) -> None:
    _arguments.option(
        parser, "--duration", _arguments.seconds, "S", "length of a run in s (default: the file's)"
    )
    text = "seed of everything that is drawn (default: the file's; 0 draws a fresh one)"
    _arguments.option(parser, "--seed", _arguments.natural, "N", text)
    _arguments.option(parser, "--robots", _arguments.positive, "N", ROBOTS)
    _arguments.flag(parser, "--blind", "no virtual sensors (all read 0): the control experiment")
    _arguments.flag(parser, "--json", "print the summary, or what --dry says, as one JSON object")


def add_settings(parser: argparse.ArgumentParser) -> None:
    """Declares `--set`, with one value per setting."""
    text = (
        "a value instead of the file's; ELEMENT is an element's name or id, a controller's"
        " library (for its parameters), 'sensor' or 'actuator' (for all virtual ones); may be"
        " given again"
    )
    _arguments.repeated(parser, "--set", _arguments.setting, "ELEMENT.ATTRIBUTE=VALUE", text)


def add_trust(parser: argparse.ArgumentParser) -> None:
    """Declares which robots are believed."""
    add_key(parser)
    add_insecure(
        parser, "take robots that have no key, too: anyone on the network can drive robots"
    )


def add_key(parser: argparse.ArgumentParser) -> None:
    """Declares where the swarm's keys are."""
    text = (
        "the swarm's keys, which 'vsense robot keys' makes (default: vsense/swarm.key in"
        " ~/.config or $XDG_CONFIG_HOME)"
    )
    _arguments.option(parser, "--key", Path, "FILE", text)


def key_path(options: argparse.Namespace) -> Path:
    """Where the swarm's keys are."""
    from vsense.robots.link import keys

    return options.key or keys.default_path()


def add_insecure(parser: argparse.ArgumentParser, text: str, page: bool = True) -> None:
    """Declares `--insecure`, with `page` that of a page, too."""
    _arguments.flag(parser, "--insecure", f"{text}; {_arguments.INSECURE_PAGE}" if page else text)


def trust_of(options: argparse.Namespace) -> LinkTrust:
    """Returns what `add_trust` declares; raises as `opening.trust_of`."""
    from vsense.modes.live import opening

    return opening.trust_of(options.key, options.insecure)


def add_legacy_port(parser: argparse.ArgumentParser) -> None:
    """Declares the port for robots with the original's client."""
    text = (
        "serve robots that still run the original's client, too, on this TCP port; 0 takes a free"
        " one (default: serve none)"
    )
    _arguments.option(parser, "--legacy-port", _arguments.port, "P", text)


def add_foxglove(parser: argparse.ArgumentParser) -> None:
    """Declares that Foxglove is served."""
    usual = FoxgloveAddress()
    parser.add_argument_group("Foxglove").add_argument(
        "--foxglove",
        type=lambda text: FoxgloveAddress(*_arguments.address(text)),
        nargs="?",
        const=usual,
        metavar="[ADDRESS:]PORT",
        help="serve the same to Foxglove, to look only and on this machine only (default port:"
        f" {usual.port}); with an address such as 0.0.0.0:{usual.port} any machine that"
        " reaches it can look: there are no tokens",
    )


_OF_ROS, _MOST_DOMAIN = -1, 232
"""The domain that ROS_DOMAIN_ID says; the highest that has ports.
Source: OMG DDSI-RTPS 2.5, 9.6.2.3."""


def _add_ros2(parser: argparse.ArgumentParser) -> None:
    """Declares that robots' poses are published for ROS 2."""
    parser.add_argument_group("ROS 2").add_argument(
        "--ros2",
        type=_domain,
        nargs="?",
        const=_OF_ROS,
        metavar="DOMAIN",
        help="publish tf, poses and readings on DDS for ROS 2, to look only; without DOMAIN in that"
        " of ROS_DOMAIN_ID, or 0",
    )


def _ros2_of(options: argparse.Namespace) -> int | None:
    """The domain of DDS, None: none; raises UsageError."""
    domain: int | None = options.ros2
    if domain != _OF_ROS:
        return domain
    try:
        return _domain(os.environ.get("ROS_DOMAIN_ID", "") or "0")
    except argparse.ArgumentTypeError as error:
        raise UsageError(f"ROS_DOMAIN_ID: {error}") from None


def _domain(text: str) -> int:
    if not (text.isdecimal() and len(text) <= 3 and int(text) <= _MOST_DOMAIN):
        raise argparse.ArgumentTypeError(f"'{text}': expected a domain from 0 to {_MOST_DOMAIN}")
    return int(text)


def add_doors(
    parser: argparse.ArgumentParser, default: tuple[str, int] | None = None, insecure: bool = True
) -> None:
    """Declares where one looks at it: the page, as in `add_web`, Foxglove and ROS 2."""
    _arguments.add_web(parser, default, insecure)
    add_foxglove(parser)
    _add_ros2(parser)


def doors_of(options: argparse.Namespace) -> dict[str, Any]:
    """Returns what `add_doors` declares: where each is, None: nowhere; raises UsageError."""
    doors = {"web": _arguments.web_of(options), "foxglove": options.foxglove}
    return doors | {"ros2": _ros2_of(options)} if "ros2" in options else doors


def add_hold(parser: argparse.ArgumentParser, text: str) -> argparse._ArgumentGroup:
    """Declares that runs wait for a start; gives the group of the control room's options."""
    group = parser.add_argument_group("control room")
    _arguments.flag(group, "--hold", text)
    return group


def add_locked(group: Any) -> None:
    """Declares that a page only shows the world."""
    text = "nobody can change the world on the page while it runs: drag a light, set a noise, ..."
    _arguments.flag(group, "--locked", text)


def add_recording(group: argparse._ArgumentGroup) -> None:
    """Declares what is recorded."""
    text = "record every run to an MCAP file from its beginning: about 2 MB a minute of 15 robots"
    _arguments.flag(group, "--record", text)
    text = (
        "recordings hold the cameras' pictures, too, unchanged: for vsense replay --retrack;"
        " about 1.3 GB a minute of four cameras with 2 megapixels and 10 Hz"
    )
    _arguments.flag(group, "--record-images", text)


def add_room(parser: argparse.ArgumentParser) -> None:
    """Declares how the runs are seen, steered and kept: the control room."""
    add_doors(parser, insecure=False)
    group = add_hold(
        parser,
        "start no run by itself, but with a key, on the page or with vsense control start; after a"
        " run wait for the next one, until Ctrl-C",
    )
    text = "a series of N runs; the seed of each is the one before plus 1 (default: 1)"
    _arguments.option(group, "--runs", _arguments.positive, "N", text, 1)
    _add_home(group)
    add_locked(group)
    add_recording(group)


def _add_home(group: Any) -> None:
    """Declares where robots drive before a run, and who does not play in it."""
    _arguments.flag(
        group,
        "--home",
        "before each run the robots drive to their starts by themselves: where the file places"
        " them, or the run's seed; robots of the same kind (controller, base) exchange places",
    )
    _arguments.flag(
        group,
        "--home-virtual-walls",
        "as --home, and on their ways they keep clear of virtual walls, too",
    )
    text = (
        "before each run: robots with less in their batteries, or whose bases say only that it"
        " is low, are named, drive to their starts and rest there while the others run, until they"
        " have another one, or a spare of the roster has their role from the next run on (default:"
        " 0, no robot rests)"
    )
    volts = _arguments.number(0.0, MOST_VOLTS, f"0 to {MOST_VOLTS:g} V, such as 3.5")
    _arguments.option(group, "--battery", volts, "VOLTS", text, 0.0)


def room_of(options: argparse.Namespace, *absent: str) -> RoomOptions:
    """Returns what `add_room` declares; raises as `RoomOptions.check`, before anything is built.

    `absent`: as in `fill`.
    """
    from vsense.monitor.ui.room import RoomOptions

    room = _arguments.fill(
        RoomOptions, options, *absent, **doors_of(options), series=None, tokens=None
    )
    room.check()
    return room


def staged_of(options: argparse.Namespace, *absent: str) -> dict[str, Any]:
    """Control room and link, as `add_room` and the commands declare them; `absent` as in `fill`."""
    from vsense.modes.live.opening import LinkOptions

    return {"room": room_of(options), "link": _arguments.fill(LinkOptions, options, *absent)}


def options_of(
    options: argparse.Namespace, stage: Stage, settings: Mapping[str, str] | None = None
) -> ExperimentOptions:
    """Returns what `add_experiment` declares; `settings` are by default those of `--set`."""
    return _arguments.fill(
        ExperimentOptions,
        options,
        stage=stage,
        settings=dict(options.set) if settings is None else settings,
        code=_arguments.code_of(options),
        casting=_rosters.casting_of(options, stage is Stage.RUN),
        virtual_devices=getattr(options, "virtual_devices", False),
    )


def is_dry(options: argparse.Namespace, asked: ExperimentOptions) -> bool:
    """Whether the experiment is only described (`--dry`), which is then done."""
    if options.dry:
        for text in asked.described(options.json):
            print_data(text)
    return bool(options.dry)
