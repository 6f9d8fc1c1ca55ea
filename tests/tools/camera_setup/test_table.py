"""The table of cameras, and the same as data."""

from __future__ import annotations

import json

from tests.tools.camera_setup.stage import found
from vsense.tools.camera_setup import files
from vsense.vision.cameras.discovery import V4L2, Details


def test_table_has_a_row_per_camera_and_trouble_below_it() -> None:
    webcam = found(id="/dev/video0", kind=V4L2, address="usb-1", model="", details=Details(),
                   trouble="no permission: add yourself to the group video")  # fmt: skip
    lines = files.lines([found(), webcam])
    assert lines == [
        "id             kind  address        model        resolution  rate   formats",
        "Maker-Model-7  GigE  192.168.10.11  Maker Model  1620x1220   25 Hz  Mono8 BayerRG8"
        " BayerGB8 +2",
        "/dev/video0    V4L2  usb-1          -            -           -      -",
        "  ! no permission: add yourself to the group video",
    ]


def test_what_vsense_takes_comes_first() -> None:
    assert files.formats(["RGB8", "Mono8"]) == "Mono8 RGB8"
    assert files.formats(["YUYV", "MJPG"]) == "YUYV MJPG"
    assert files.formats([]) == "-"


def test_data_has_everything_and_null_for_what_is_not_known() -> None:
    facts = json.loads(json.dumps(files.facts(found())))
    assert facts["formats"] == ["RGB8", "BayerRG8", "Mono8", "Mono16", "BayerGB8"]
    assert (facts["width_px"], facts["height_px"], facts["gain_bounds"]) == (1620, 1220, [0, 24])
    assert facts["trouble"] is None
    facts = files.facts(found(details=Details(), address="", mac="", trouble="busy"))
    unknown = {name for name, value in facts.items() if value is None}
    assert {"width_px", "rate_hz", "address", "mac", "gain"} <= unknown
    assert facts["trouble"] == "busy"
