"""Pictures to try `vsense calibrate` with, where no camera is at hand."""

from __future__ import annotations

import sys
from pathlib import Path

import cv2

from vsense.calibration.board import Board
from vsense.config.specs import Arena
from vsense.errors import UsageError
from vsense.lab.board_studio import BoardStudio, board_plan
from vsense.lab.rig import rig

ARENA = Arena((3.0, 2.4, 1.0), (0.0, 0.0, 0.5))
FLOOR, HELD = 16, 24
"""How many times the board lies on the floor and is held up."""

_QUALITY = 95


def write(directory: Path, board_text: str, seed: int) -> int:
    """Writes pictures/CAMERA/MOMENT.jpg and truth/CAMERA.json; says how to go on.

    Raises:
        UsageError: The board is none, or the folder cannot be written.
    """
    board, cameras = Board.parse(board_text), rig(ARENA)
    plan = board_plan(cameras, board, FLOOR, HELD, seed)
    try:
        (directory / "truth").mkdir(parents=True, exist_ok=True)
        for camera in cameras:
            (directory / "pictures" / camera.id).mkdir(parents=True, exist_ok=True)
            (directory / "truth" / f"{camera.id}.json").write_text(camera.to_json() + "\n")
        studio, count = BoardStudio(cameras, board, seed), 0
        for moment, pose in plan:
            for shot in studio.take(moment, pose):
                data = cv2.imencode(".jpg", shot.image, (cv2.IMWRITE_JPEG_QUALITY, _QUALITY))[1]
                path = directory / "pictures" / shot.camera / f"{moment}.jpg"
                path.write_bytes(data.tobytes())
                count += 1
    except OSError as error:
        raise UsageError(f"{directory}: cannot be written: {error.strerror}") from None
    print(directory / "pictures")
    x, y, _ = plan[0][1].shift
    print(
        f"{count} pictures of {len(cameras)} cameras; now: vsense calibrate rig --board {board} "
        f"--pictures {directory / 'pictures'} --floor 'floor_*' --origin={x:.3f},{y:.3f},0 "
        "-o cameras",
        file=sys.stderr,
    )
    return 0
