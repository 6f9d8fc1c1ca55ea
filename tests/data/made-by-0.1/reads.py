"""Reads what 0.1 left, with the imports that the pages of 0.1 show. First argument: this folder."""

import sys
from pathlib import Path

from vsense.cameras.camera import Camera
from vsense.lab.truth import read_truth
from vsense.recording.reader import open_recording
from vsense.report.report import make_report
from vsense.sensors.quality import Scale
from vsense.sim import campaign
from vsense.sim.campaign import Campaign
from vsense.sim.engine import Engine
from vsense.sim.job import Setup, Sweep
from vsense.terminal import Console, interruption

folder = Path(sys.argv[1])
with open_recording(folder / "lab-run" / "mine.mcap") as recording:
    print("timesteps", sum(1 for _ in recording.messages({"/arena"})))
print("truth", len(read_truth(folder / "lab-run" / "truth.bin")))
for name in (Camera, make_report, Scale, campaign, Campaign, Engine, Setup, Sweep, Console):
    assert name is not None
assert interruption is not None
