"""What the last picture of a tracked run shows of its camera is told, as of all others."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.system.recording import make_recording
from vsense import cli
from vsense.vision.tracking.camera_tracking import CameraTracking


def test_every_picture_of_a_run_is_checked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    taken: list[str] = []
    check, take = CameraTracking.check_cameras, CameraTracking.next

    def checked(tracking: CameraTracking) -> None:
        taken.append("checked")
        check(tracking)

    def taken_next(tracking: CameraTracking, timeout_s: float) -> object:
        moment = take(tracking, timeout_s)
        taken.append("picture")
        return moment

    monkeypatch.setattr(CameraTracking, "check_cameras", checked)
    monkeypatch.setattr(CameraTracking, "next", taken_next)
    make_recording(tmp_path, 5)
    files = [str(tmp_path / name) for name in ("resources.xml", "experiment.xml")]
    assert cli.main(["track", *files, "--offline", "--frames", "3", "--json"]) == 0
    capsys.readouterr()
    assert taken.count("picture") == 3
    assert taken[-1] == "checked"
