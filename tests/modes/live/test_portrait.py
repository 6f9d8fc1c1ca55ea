"""The picture of a run with robots that come late, or never."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.conftest import States
from tests.run.stage import DT_NS, S, Stage, experiment
from vsense.base.arena import Frame
from vsense.modes.live.run import Portrait
from vsense.monitor.pictures.run_figure import RunPictureError
from vsense.run.environment import Environment
from vsense.vision.cameras.camera import Camera


def lived(state: States, seen_from: list[int]) -> tuple[Portrait, Environment]:
    """Ten timesteps in which robot n is seen from timestep `seen_from[n]` on."""
    stage = Stage(experiment(robots=len(seen_from), timesteps=10))
    environment = Environment(stage.experiment, seed=1)
    portrait = Portrait(stage.experiment)
    tags = [robot.tag for robot in stage.experiment.robots]
    for timestep in range(10):
        places = {
            tag: (0.3 * n - 0.5, 0.05 * timestep, 1.0)
            for n, tag in enumerate(tags)
            if timestep >= seen_from[n]
        }
        environment.step(state(places, S + timestep * DT_NS), timestep, {})
        portrait.add(timestep, environment.world, stage.robots())
    return portrait, environment


def test_who_was_never_seen_is_not_drawn(state: States, tmp_path: Path) -> None:
    portrait, environment = lived(state, [0, 4, 99])
    told = portrait._figure(np.array(portrait._sighted))
    assert told.poses.shape == (10, 2, 3) and told.lit.shape == (10, 2)
    assert told.poses[0, 1].tolist() == told.poses[4, 1].tolist() == [-0.2, 0.2, 1.0]
    path = tmp_path / "run.png"
    assert portrait.draw(path, environment.world, False, "3 robots")
    assert cv2.imread(str(path)).shape[2] == 3


def test_nobody_is_no_picture(state: States, tmp_path: Path) -> None:
    portrait, environment = lived(state, [99, 99])
    assert not portrait.draw(tmp_path / "run.png", environment.world, False, "2 robots")
    assert list(tmp_path.iterdir()) == []


def test_a_long_run_takes_bounded_memory(
    state: States, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("vsense.modes.live.run.MOST_TIMESTEPS", 4)
    portrait, environment = lived(state, [0, 0])
    told = portrait._figure(np.array(portrait._sighted))
    assert told.run_timesteps.tolist() == [0, 4, 8]
    assert len(told.poses) == len(told.samples.shares) == 3
    assert told.poses[-1, 0, 1] == pytest.approx(0.4)
    assert portrait.draw(tmp_path / "run.png", environment.world, False, "2 robots")


def test_a_picture_that_cannot_be_written_is_one_clear_line(state: States, tmp_path: Path) -> None:
    portrait, environment = lived(state, [0, 0])
    with pytest.raises(RunPictureError, match=r"run\.png: cannot be written"):
        portrait.draw(tmp_path / "gone" / "run.png", environment.world, False, "2 robots")


def test_the_cameras_are_looked_at_once_per_second_and_at_the_end(
    state: States, tmp_path: Path
) -> None:
    turning = experiment(robots=1, timesteps=40)
    stage = Stage(replace(turning, sources=(replace(turning.sources[0], turn_timestep=20),)))
    environment = Environment(stage.experiment, seed=1)
    camera = Camera.looking_down("above", 0.0, 0.0, 2.0, 120.0, (320, 240))
    portrait = Portrait(stage.experiment, [camera])
    assert (portrait._samples.moment, portrait._samples.timesteps) == (20, range(17, 20))
    (tag,) = (robot.tag for robot in stage.experiment.robots)
    image = np.random.default_rng(0).integers(80, 120, (240, 320)).astype(np.uint8)
    kept = portrait._cameras.pictures
    for timestep in range(40):
        place = {tag: (0.01 * timestep, 0.0, 1.0)}
        environment.step(state(place, S + timestep * DT_NS), timestep, {})
        frame = Frame("above", image, timestep, 0, 0)
        portrait.add(timestep, environment.world, stage.robots(), [frame])
        if timestep == 15:
            # Nobody knows whether this run will be stopped now.
            assert list(kept) == [10]
            assert kept[10]["above"] is not image, "lent pictures go back"
    assert list(kept) == [19, 39]
    path = tmp_path / "run.png"
    assert portrait.draw(path, environment.world, False, "1 robot")
    bare = tmp_path / "bare.png"
    portrait._cameras.pictures.clear()
    assert portrait.draw(bare, environment.world, False, "1 robot")
    assert cv2.imread(str(path)).shape[0] > cv2.imread(str(bare)).shape[0] + 500
