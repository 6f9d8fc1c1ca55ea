"""`vsense camera arena`: where the experiment's arena is, among the real walls."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from vsense.base.errors import UsageError
from vsense.commands import _arguments
from vsense.config import experiment
from vsense.tools.camera_setup import aligning

DESCRIPTION = (
    "`align` moves the frame of all calibrated cameras so that the experiment's arena lies between"
    " the real walls. What the cameras know of each other stays as it is."
)
_STORY = (
    "Says where the corners of an experiment's arena really are: by dragging them onto cameras'"
    " pictures, in a page that this machine serves to itself, or by pixels. All camera files turn"
    " and shift together, so that everything that uses them follows; they are kept as they were"
    " beside them. sw, se, ne and nw are the corners of low and high x and y."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    actions = parser.add_subparsers(title="actions", metavar="ACTION", dest="action", required=True)
    step = actions.add_parser(
        "align", help="move the arena frame onto the real walls", description=_STORY
    )
    _add_align(step)


def run(options: argparse.Namespace) -> int:
    """Runs the action; see `vsense.tools.camera_setup.aligning`."""
    if options.undo:
        return aligning.undo(options.cameras)
    if options.experiment is None:
        raise UsageError("expected an experiment, whose arena it is, or --undo")
    asked = _arguments.fill(aligning.AlignOptions, options, clicks=options.click)
    return aligning.run(asked, experiment.load(options.experiment).arena.corners_m)


def _add_align(step: Any) -> None:
    step.add_argument(
        "experiment",
        nargs="?",
        help="whose arena it is: a shipped experiment's name, or the path of a .argos file",
    )
    text = "folder with the camera files in use (default: cameras)"
    _arguments.option(step, "--cameras", Path, "DIR", text, Path("cameras"))
    text = (
        "what to drag the corners on: a folder with a folder per camera, as `vsense camera"
        " shoot` makes it; each camera's last picture counts"
    )
    _arguments.many(step, "--pictures", Path, "PATH", text)
    _arguments.option(step, "--camera", str, "NAME", _arguments.ONE_CAMERA)
    _arguments.option(step, "--port", _arguments.port, "P", "of the page (default: a free one)", 0)
    _add_clicks(step)
    _arguments.flag(step, "--dry", "say what would be changed, and change nothing")
    _arguments.flag(step, "--undo", "put the camera files back as they were before the last time")
    _arguments.flag(step, "--json", "print what was found as one JSON object on standard output")


def _add_clicks(step: Any) -> None:
    """Declares where the corners are, where no page says it, and which points they are."""
    text = "without a page: a camera shows a corner at this pixel; once for each"
    _arguments.repeated(step, "--click", str, "CAMERA:POINT:X,Y", text)
    _arguments.option(step, "--seen", Path, "CSV", "or all of them: camera,id,x_px,y_px")
    text = "other points than the corners: id,x_m,y_m in the arena and perhaps z_m"
    _arguments.option(step, "--points", Path, "CSV", text)
    text = (
        "how high above the floor the corners are that are clicked on, such as 12cm for the"
        " walls' upper edges (default: 0cm)"
    )
    _arguments.option(step, "--height", _arguments.length_m, "LENGTH", text, 0.0)
