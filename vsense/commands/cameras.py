"""`vsense camera list`: what is plugged in, how it looks, and how it is set up."""

from __future__ import annotations

import argparse
from pathlib import Path

from vsense.base.errors import UsageError
from vsense.base.interruption import interruption
from vsense.base.terminal import Console, drop_output
from vsense.commands import COMMANDS, _arguments, _experiments, _rosters
from vsense.commands._arguments import Options
from vsense.config.experiment import first_robots, load, of_folder
from vsense.config.placement import settle
from vsense.config.resources import EXPOSURE_RANGE_US, GAIN_RANGE, RATES_HZ, SIDES_PX
from vsense.config.specs import LINES_PORT, Stage
from vsense.tools.camera_setup import files, node, shooting, showing, tuning
from vsense.vision.cameras.source import Controls

DESCRIPTION = "What is plugged in: GigE Vision, USB3 Vision, V4L2."

_ID = (
    "what `vsense camera list` lists as its id or address, its serial number, /dev/video0, a URL,"
    " or with --resources the id of a grabber"
)
CAMERAS_PORT = 4060
"""Where rendered cameras are, unless told otherwise."""
_TAKEN = {
    "width": SIDES_PX,
    "height": SIDES_PX,
    "rate": RATES_HZ,
    "exposure": EXPOSURE_RANGE_US,
    "gain": GAIN_RANGE,
}
"""What options may be, by their names."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    name = parser.prog.split()[-1]
    text = COMMANDS[f"camera {name}"][1]
    parser.description = f"{text[:1].upper()}{text[1:]}."
    _ACTIONS[name](parser)


def _add_show(parser: argparse.ArgumentParser) -> None:
    _add_camera(parser)
    text = "take one picture into a file (.png, .jpg, .pgm) instead of showing it in the page"
    _arguments.option(parser, "--save", Path, "FILE", text)
    _arguments.add_web(parser, _arguments.WEB)


def _add_tune(parser: argparse.ArgumentParser) -> None:
    _add_camera(parser)
    text = "try exposures and gains, say which are best, and put the camera's own values back"
    _arguments.flag(parser, "--sweep", text)
    _add_json(parser)
    group = parser.add_argument_group("what is in the picture")
    text = "of the robots (default: 0.13, an e-puck's maximum)"
    _arguments.option(group, "--speed", _positive, "M/S", text, tuning.SPEED_M_S)
    text = "pixels per metre at the markers (default: from the markers in the picture)"
    _arguments.option(group, "--px-per-m", _positive, "PX", text)
    _arguments.option(group, "--focal-px", _positive, "PX", "or: focal length, with --height-m")
    _arguments.option(group, "--height-m", _positive, "M", "from the lens down to the markers")
    text = "or: the calibrated camera of the resources file"
    _arguments.option(group, "--camera", str, "ID", text)
    text = "of the markers above the floor, for --camera (default: 0.06)"
    _arguments.option(group, "--marker-height", _positive, "M", text, 0.06)


def _add_init(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "directory",
        type=Path,
        nargs="?",
        default=Path(),
        metavar="DIR",
        help="where resources.xml, experiment.xml and their schemas go (default: here)",
    )
    _arguments.flag(parser, "--force", "write over files that are there")


def _add_pretend(parser: argparse.ArgumentParser) -> None:
    text = "where resources.xml and experiment.xml of these cameras go, unless they are there"
    parser.add_argument("directory", type=Path, metavar="DIR", help=text)
    text = (
        "whose arena, walls, robots and objects they see: a shipped experiment's name, or the path"
        f" of a .argos file (default: {_experiments.DEFAULT})"
    )
    _arguments.option(parser, "--experiment", of_folder, "NAME", text, _experiments.DEFAULT)
    _arguments.option(parser, "--robots", _arguments.positive, "N", _experiments.ROBOTS)
    _arguments.add_code(parser)
    _rosters.add_casting(parser)
    text = f"TCP port of their pictures, on this machine only (default: {CAMERAS_PORT})"
    _arguments.option(parser, "--port", _arguments.port, "P", text, CAMERAS_PORT)
    text = (
        f"port where it hears from `vsense robot emulate` where robots are (default: {LINES_PORT})"
    )
    _arguments.option(parser, "--tracker-port", _arguments.port, "P", text, LINES_PORT)
    text = "seed of floor, light and noise (default: 1)"
    _arguments.option(parser, "--seed", _arguments.natural, "N", text, 1)


def _add_shoot(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "resources", metavar="RESOURCES", help="the resources file: all its cameras take part"
    )
    text = "gets a folder per camera (default: shoot)"
    _arguments.option(parser, "-o --output", Path, "DIR", text, Path("shoot"))
    text = (
        "say in which pictures this board is seen, such as charuco:7x5:80mm:4X4_50; see vsense"
        " camera calibrate"
    )
    _arguments.option(parser, "--board", str, "BOARD", text)
    text = "take a picture every S seconds, instead of with the Enter key"
    _arguments.option(parser, "--every", _positive, "S", text)
    text = "end after N pictures, with --every (default: with Ctrl-C)"
    _arguments.option(parser, "--count", _arguments.positive, "N", text)
    text = "the pictures are WORD_01, WORD_02, ... (default: floor)"
    _arguments.option(parser, "--name", str, "WORD", text, "floor")
    _add_json(parser)


def _add_node(parser: argparse.ArgumentParser) -> None:
    text = "the resources file of this computer: the tracker's names its grabbers"
    parser.add_argument("resources", metavar="RESOURCES", help=text)
    text = "where the tracker or a router listens, such as tcp/10.0.0.2:7447 or tls/..."
    _arguments.repeated(parser, "--connect", str, "ADDRESS", text, required=True)
    text = "as the tracker's resources file calls this node (default: this computer's name)"
    _arguments.option(parser, "--name", str, "NAME", text)
    text = "the tracker's arena, where several share a router (default: arena)"
    _arguments.option(parser, "--arena", str, "NAME", text, "arena")
    text = "Zenoh's own configuration (JSON5): certificates, access, whatever it can"
    _arguments.option(parser, "--config", Path, "FILE", text)


def _add_camera(parser: argparse.ArgumentParser) -> None:
    """Declares which camera is meant, and what it is asked for."""
    parser.add_argument("id", metavar="ID", help=_ID)
    group = parser.add_argument_group("the camera")
    text = "take ID for a grabber of this resources file, with all its settings"
    _arguments.option(group, "--resources", str, "FILE", text)
    _arguments.option(group, "--exposure", _number, "US", "exposure time in us")
    _arguments.option(group, "--gain", _number, "RAW", "in the camera's own unit")
    _arguments.option(group, "--width", _arguments.positive, "PX", "with --height")
    _arguments.option(group, "--height", _arguments.positive, "PX", "with --width")
    _arguments.option(group, "--rate", _number, "HZ", "pictures per second")
    text = "the markers to look for in its pictures (default: arrow4x4)"
    _arguments.option(parser, "--family", str, "NAME", text, "arrow4x4")


def _add_json(parser: argparse.ArgumentParser) -> None:
    _arguments.flag(parser, "--json", "print it as JSON")


_ACTIONS = {
    "list": _add_json,
    "show": _add_show,
    "tune": _add_tune,
    "init": _add_init,
    "shoot": _add_shoot,
    "pretend": _add_pretend,
    "node": _add_node,
}
"""What declares each action's arguments."""


def _positive(text: str) -> float:
    value = _number(text)
    if not 0.0 < value <= 1e7:
        raise argparse.ArgumentTypeError(f"'{text}': expected a number above 0")
    return value


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is no number") from None


def run(options: argparse.Namespace) -> int:
    """Runs an action."""
    actions = {
        "list": lambda: files.list_cameras(options.json),
        "show": lambda: showing.run(
            _asked(showing.ShowOptions, options, web=_arguments.web_of(options))
        ),
        "tune": lambda: tuning.run(_asked(tuning.TuneOptions, options)),
        "init": lambda: files.init(options.directory, options.force),
        "shoot": lambda: shooting.run(_arguments.fill(shooting.ShootOptions, options)),
        "pretend": lambda: _pretend(options),
        "node": lambda: node.run(_arguments.fill(node.NodeOptions, options)),
    }
    try:
        return actions[options.command]()
    except BrokenPipeError:
        drop_output()
        return 0


def _pretend(options: argparse.Namespace) -> int:
    """Renders cameras until Ctrl-C or SIGTERM; returns 130 or 143."""
    from vsense.modes.lab.network_cameras import NetworkCameras

    casting, code = _rosters.casting_of(options, here=True), _arguments.code_of(options)
    loaded = load(options.experiment, stage=Stage.LAB, code=code, casting=casting)
    experiment = settle(first_robots(loaded, options.robots), options.seed)
    console, marker = Console(), experiment.marker
    whose = f"these are those of {experiment.file}"
    console.progress("building the scene")
    place = options.seed, options.port, options.tracker_port, console.say
    with interruption() as interrupted, NetworkCameras(experiment, *place) as cameras:
        console.end_progress()
        markers = files.Markers(
            list(experiment.tags.values()), whose, marker.family, marker.height_m
        )
        files.init_pretended(options.directory, cameras.found, markers)
        console.say(
            f"{len(cameras.found)} cameras above {experiment.name}'s arena; they wait for"
            f" `vsense robot emulate` on port {cameras.lines_port}, which says where robots are"
        )
        cameras.run(interrupted, console.progress)
        console.end_progress()
    return interrupted.code


def _asked(kind: type[Options], options: argparse.Namespace, **given: object) -> Options:
    return _arguments.fill(kind, options, wanted=wanted_of(options), **given)


def wanted_of(options: argparse.Namespace) -> Controls:
    """What the command line asks a camera for; UsageError beyond what the resources file takes."""
    for name, bounds in _TAKEN.items():
        value = getattr(options, name)
        if value is not None and not bounds[0] <= value <= bounds[1]:
            raise UsageError(f"--{name}: {value:g} is not from {bounds[0]:g} to {bounds[1]:g}")
    if (options.width is None) != (options.height is None):
        raise UsageError("expected --width together with --height")
    size_px = None if options.width is None else (options.width, options.height)
    return Controls(size_px, options.rate, options.exposure, options.gain)
