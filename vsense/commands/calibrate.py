"""`vsense camera calibrate`: from pictures of a printed board to camera files."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any

from vsense.base.errors import UsageError
from vsense.commands import _arguments
from vsense.config import tracking_session
from vsense.config.experiment import load, of_folder
from vsense.config.specs import Stage
from vsense.modes.lab import board_studio
from vsense.vision.calibration import checking, foreign, session
from vsense.vision.tracking.specs import TrackingSession

DESCRIPTION = (
    "Calibrates cameras from pictures of a printed board: print one with `board`, take pictures,"
    " and let `rig` solve lenses and poses of all cameras together. `intrinsics` calibrates lenses"
    " alone. Camera files, one per camera, go into the output folder, and beside them a report"
    " with the reprojection error of every view, in numbers and as a picture."
)

_BOARD = (
    "chessboard:7x5:30mm (inner corners, side of a square) or charuco:4x5:54mm:4X4_1000 (squares,"
    " side, markers), followed by any of :inverted :legacy :marker=0.75"
)
_RIG_STORY = (
    "Take pictures of one board with all cameras at once: lying on the floor in several places,"
    " and held up and tilted by 20 to 45 degrees, also where two cameras see it. The first moment"
    " that --floor names makes the arena frame: origin in the lower left corner of the board's"
    " lower left square, x along its rows, y up its columns, floor at z = 0. Or measure points:"
    " --points with --seen or --tags."
)
_PICTURES = (
    "picture files, videos, a folder of pictures, or a folder with a folder or video per camera;"
    " folders and videos are named after their cameras, and pictures with the same name show the"
    " same moment, unless a timestamps.csv in a camera's folder says better"
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    steps = parser.add_subparsers(dest="step", title="steps", metavar="STEP", required=True)
    _add_board(steps)
    _add_intrinsics(steps)
    _add_rig(steps)
    _add_check(steps)
    _add_foreign(steps)
    _add_example(steps)


def run(options: argparse.Namespace) -> int:
    """Runs one step; see `vsense.vision.calibration.session`."""
    if options.step == "example":
        above = None if options.experiment is None else load(options.experiment, stage=Stage.LAB)
        return board_studio.write(options.directory, options.board, options.seed, above)
    if options.step == "check":
        tracking = _session(options.tracking) if options.tracking else None
        arena_m = None
        if options.experiment is not None:
            arena_m = load(options.experiment, stage=Stage.LAB).arena.corners_m
        given = {"tracking": tracking, "arena_m": arena_m}
        return checking.run(_arguments.fill(checking.CheckOptions, options, **given))
    if options.step == "import":
        return foreign.bring_in(options.files, options.name, options.output)
    if options.step == "export":
        return foreign.send_out(options.cameras, options.format, options.output)
    if options.step == "board":
        return session.print_board(options.board, options.output)
    if options.step == "intrinsics":
        return session.intrinsics(_arguments.fill(session.LensOptions, options))
    return session.rig(_arguments.fill(session.RigOptions, options))


def _session(files: list[str]) -> TrackingSession:
    if len(files) > 2:
        raise UsageError("--tracking: expected a folder, or resources and an experiment file")
    return tracking_session.load(*files) if files[1:] else tracking_session.load_whole(*files)


def _add_board(steps: Any) -> None:
    step = steps.add_parser(
        "board", help="draw a board to print", description="Draws a board, true to scale."
    )
    step.add_argument("board", metavar="BOARD", help=_BOARD)
    _arguments.option(step, "-o --output", Path, "FILE", "file.pdf or file.png", required=True)


def _add_intrinsics(steps: Any) -> None:
    step = steps.add_parser(
        "intrinsics",
        help="calibrate the lens of each camera by itself",
        description="Calibrates lenses from 10 to 20 pictures per camera, with the board all over"
        " the picture and tilted by 20 to 45 degrees to each side. The poses in the camera files"
        " mean nothing until `rig` finds them.",
    )
    _arguments.option(step, "--board", str, "BOARD", _BOARD, required=True)
    _add_sources(step)


def _add_rig(steps: Any) -> None:
    step = steps.add_parser("rig", help="calibrate all cameras together", description=_RIG_STORY)
    _arguments.option(step, "--board", str, "BOARD", _BOARD)
    _add_sources(step)
    text = "folder with camera files whose lenses are right already and stay as they are"
    _arguments.option(step, "--intrinsics", Path, "DIR", text)
    _arguments.flag(step, "--refine", "let these lenses move a little, by half a percent")
    _add_floor(step, "the board", "the board's")
    text = "where the board's origin was at the first of them, in m and degrees (default: 0,0,0)"
    _arguments.option(step, "--origin", _place, "X,Y,DEG", text, (0.0, 0.0, 0.0))
    _add_points(step)


def _add_floor(step: argparse.ArgumentParser, board: str, whose: str) -> None:
    """Declares when a board lay on the floor, and how thick it is."""
    text = f"moments when {board} lay on the floor: names or patterns such as 'floor_*'"
    _arguments.many(step, "--floor", str, "MOMENT", text)
    text = f"how high {whose} printed face was above the floor, such as 5mm (default: 0mm)"
    _arguments.option(step, "--thickness", _arguments.length_m, "LENGTH", text, 0.0)


def _add_points(step: argparse.ArgumentParser) -> None:
    _arguments.option(step, "--points", Path, "CSV", "known points: id,x_m,y_m,z_m in the arena")
    _arguments.option(step, "--seen", Path, "CSV", "where they are seen: camera,id,x_px,y_px")
    text = "or: the points are middles of tags, ids their numbers, such as 4X4_50 or 36h11"
    _arguments.option(step, "--tags", str, "DICT", text)
    text = "how well the points are known (default: 1mm)"
    _arguments.option(step, "--accuracy", _arguments.length_m, "LENGTH", text, 0.001)


def _add_check(steps: Any) -> None:
    step = steps.add_parser(
        "check",
        help="say how true the calibration in use is, by measured points or a second board",
        description="Holds what the cameras see against points that were measured with a tape, or"
        " against a second board on the floor; prints how far off each camera is, and keeps that"
        " beside the camera files: later runs, recordings and reports show it. --tracking shows"
        " where cameras cannot read the robots' markers, and needs no points. With --pictures alone"
        " it says which cameras were moved since the calibration, and fails (1) where one was.",
    )
    text = "folder with the camera files in use (default: cameras)"
    _arguments.option(step, "--cameras", Path, "DIR", text, Path("cameras"))
    _add_measured(step)
    _add_second_board(step)
    _add_pictures(step)
    _arguments.flag(
        step,
        "--keep",
        "make what stands still in these pictures the cameras' references, with which later ones"
        " and every run's first pictures are compared (vsense camera calibrate rig does it itself)",
    )
    text = (
        "paint in report/legible.png where each camera shows the markers too small to be read,"
        " and say it: resources and experiment file of vsense camera track, or their folder"
    )
    _arguments.many(step, "--tracking", str, "FILE", text)
    text = "only in its arena: a shipped experiment's name, or the path of a .argos file"
    _arguments.option(step, "--experiment", of_folder, "NAME", text)
    text = "fail (1) where a point is farther off, such as 5mm"
    _arguments.option(step, "--limit", _arguments.length_m, "LENGTH", text)
    _arguments.flag(step, "--json", "print the check as one JSON object on standard output")


def _add_measured(step: argparse.ArgumentParser) -> None:
    text = "measured points: id,x_m,y_m in the arena and, where they are not on the floor, z_m"
    _arguments.option(step, "--points", Path, "CSV", text)
    _arguments.option(step, "--seen", Path, "CSV", "where they are seen: camera,id,x_px,y_px")
    text = "or: ArUco or AprilTag markers lie there, such as 4X4_50"
    _arguments.option(step, "--tags", str, "DICT", text)
    text = "or: robots' markers are there, ids their tags, z_m their height; such as arrow4x4"
    _arguments.option(step, "--markers", str, "FAMILY", text)
    _arguments.option(
        step, "--distances", Path, "CSV", "tape measures between points: from,to,distance_m"
    )


def _add_second_board(step: argparse.ArgumentParser) -> None:
    """Declares a board on the floor that the calibration has not seen."""
    _arguments.option(step, "--board", str, "BOARD", f"instead of points: {_BOARD}")
    _add_floor(step, "that board", "its")


def _add_foreign(steps: Any) -> None:
    step = steps.add_parser(
        "import",
        help="take calibrations of OpenCV, ROS or caliscope",
        description="Makes camera files of other programs' calibrations, and says by how many px"
        " both differ: OpenCV's YAML (camera_matrix, distortion_coefficients, image_width,"
        " image_height; rotation and translation from arena to camera, if they are there), ROS's"
        " camera_info YAML, caliscope's camera_array.toml. Fisheye and rational lenses are"
        " refused.",
    )
    _arguments.many(step, "files", Path, "FILE", ".yml, .yaml or .toml")
    text = (
        "the camera's name, where a file has one camera (default: what the file says, or its own)"
    )
    _arguments.option(step, "--name", str, "NAME", text)
    text = "folder for camera files (default: cameras)"
    _arguments.option(step, "-o --output", Path, "DIR", text, Path("cameras"))
    step = steps.add_parser(
        "export",
        help="give the calibration to OpenCV, ROS or caliscope",
        description="Writes camera files for other programs, reads them again, and says by how"
        " many px both differ. ROS's camera_info has no poses.",
    )
    text = "whose files are written"
    _arguments.choice(step, "--format", tuple(foreign.FORMATS), text, required=True)
    text = "folder with the camera files in use (default: cameras)"
    _arguments.option(step, "--cameras", Path, "DIR", text, Path("cameras"))
    _arguments.option(step, "-o --output", Path, "DIR", "folder for the files (default: .)", Path())


def _add_example(steps: Any) -> None:
    step = steps.add_parser(
        "example",
        help="draw pictures to try it with, of the lab's four cameras",
        description="Writes pictures of a board as the lab's four cameras see it, and the camera"
        " files that a perfect calibration of them would find.",
    )
    step.add_argument("directory", type=Path, help="folder for pictures/ and truth/")
    _arguments.option(step, "--board", str, "BOARD", _BOARD, "charuco:7x5:80mm:4X4_50")
    text = (
        "above its arena, as vsense camera pretend: a shipped experiment's name, or the path of a"
        " .argos file (default: above 3 m x 2.4 m)"
    )
    _arguments.option(step, "--experiment", of_folder, "NAME", text)
    _arguments.option(step, "--seed", _arguments.natural, "N", "seed of poses and noise", 1)


def _add_pictures(step: argparse.ArgumentParser) -> None:
    _arguments.many(step, "--pictures", Path, "PATH", _PICTURES)
    _arguments.option(step, "--camera", str, "NAME", _arguments.ONE_CAMERA)
    text = "take every N-th picture of a video (default: 1)"
    _arguments.option(step, "--every", _arguments.positive, "N", text, 1)


def _add_sources(step: argparse.ArgumentParser) -> None:
    _add_pictures(step)
    text = "instead of pictures: corners found before, camera,moment,corner,x_px,y_px"
    _arguments.option(step, "--corners", Path, "CSV", text)
    _arguments.option(step, "--size", _size, "WxH", "size of the pictures that --corners came from")
    text = "folder for camera files and report (default: cameras)"
    _arguments.option(step, "-o --output", Path, "DIR", text, Path("cameras"))
    _arguments.flag(step, "--json", "print the report as one JSON object on standard output")


def _place(text: str) -> tuple[float, float, float]:
    try:
        x, y, degrees = (float(part) for part in text.split(","))
    except ValueError:
        x = math.nan
    if not math.isfinite(x) or not math.isfinite(y) or not math.isfinite(degrees):
        raise argparse.ArgumentTypeError(f"'{text}': expected x,y,degrees such as 0.5,-1,90")
    return x, y, degrees


def _size(text: str) -> tuple[int, int]:
    pattern, expected = r"([0-9]{2,5})x([0-9]{2,5})", "width x height such as 1280x720"
    match = _arguments.matched(pattern, text, expected)
    return int(match[1]), int(match[2])
