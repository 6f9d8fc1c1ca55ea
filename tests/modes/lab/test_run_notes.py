"""What the host keeps of a run's pictures."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from vsense.base.arena import Frame
from vsense.config.experiment import load
from vsense.modes.lab._metrics import TrackingTally
from vsense.modes.lab.session import RunNotes
from vsense.monitor.pictures.run_samples import RunSamples
from vsense.run.figures import Figures


def test_pictures_of_runs_that_others_follow_take_little(tmp_path: Path) -> None:
    experiment = load("pollutant")
    notes = RunNotes(
        RunSamples(experiment), Figures(experiment), TrackingTally(()), 1, tmp_path, experiment, ()
    )
    noise = np.random.default_rng(1).integers(0, 12, (600, 800), dtype=np.uint8)
    image = cv2.circle(noise + np.uint8(80), (300, 200), 50, 230, -1)
    frames = [Frame(name, image, 7, 0, 0) for name in ("left", "right")]
    notes.keep(7, frames)
    image[:] = 0  # as the camera's next picture
    notes.pack()
    notes.keep(9, frames[:1])
    shown = notes.all_pictures()
    assert [*shown] == [7, 9] and [*shown[7]] == ["left", "right"] and [*shown[9]] == ["left"]
    assert shown[7]["left"].shape == (600, 800)
    assert abs(int(shown[7]["left"][200, 300]) - 230) < 10 and shown[7]["left"][500, 700] < 110
    assert not shown[9]["left"].any()
    assert sum(coded.nbytes for coded in notes.packed[7].values()) < 0.5 * 2 * image.nbytes
