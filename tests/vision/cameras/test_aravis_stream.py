"""What is said of a system that has no room for a whole picture."""

from __future__ import annotations

from pathlib import Path

import pytest

from vsense.vision.cameras import _aravis_camera


@pytest.mark.parametrize(
    "text, said",
    [
        ("212992\n", " (net.core.rmem_max is 212992, less than its 1976400 bytes)"),
        ("4194304\n", ""),
        ("", ""),
    ],
)
def test_too_little_room_for_a_picture_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str, said: str
) -> None:
    (tmp_path / "rmem_max").write_text(text)
    monkeypatch.setattr(_aravis_camera, "_MOST_WAITING", tmp_path / "rmem_max")
    assert _aravis_camera._scant(1_976_400) == said
    monkeypatch.setattr(_aravis_camera, "_MOST_WAITING", tmp_path / "nothing")
    assert _aravis_camera._scant(1_976_400) == ""
