"""What the camera process is told about the real arena: boxes, and cylinders that are round."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from vsense.config.experiment import load
from vsense.modes.lab._backdrop import Block
from vsense.modes.lab._camera_spec import LabCameraSpec, spec_for

CYLINDER = (
    '<cylinder id="{}" radius="0.1" height="0.2" movable="false" vs:physical="{}">{}</cylinder>'
)
BODY = '<body position="0.5,0.2,0" orientation="0,0,0" />'


def test_physical_cylinders_stand_in_the_pictures_and_virtual_ones_do_not(tmp_path: Path) -> None:
    text = load("pollutant").path.read_text()
    more = CYLINDER.format("a", "true", BODY) + CYLINDER.format("b", "false", BODY)
    path = tmp_path / "x.argos"
    path.write_text(text.replace("</arena>", f"{more}</arena>"))
    spec = spec_for(load(path), "truth", 1, Path("log"))
    assert [box.is_round for box in spec.boxes] == [False] * 4 + [True]
    assert spec.boxes[4] == Block(0.5, 0.2, 0.0, 0.2, 0.2, 0.2, True)
    assert LabCameraSpec.from_json(spec.to_json()) == spec


def test_a_round_outline_is_a_circle() -> None:
    outline = Block(0.5, 0.2, 1.0, 0.2, 0.2, 0.1, True).outline()
    assert np.allclose(np.hypot(*(outline - (0.5, 0.2)).T), 0.1)
    assert np.hypot(*np.diff(outline, axis=0).T).max() < 0.01
