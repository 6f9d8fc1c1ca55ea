"""The lab's recordings: the same for a seed, and tracked to where the robots truly were."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from vsense.cli import main
from vsense.config.experiment import load
from vsense.modes.lab._camera_spec import spec_for
from vsense.modes.lab.recorder import record
from vsense.vision.cameras.camera import Camera

TIMESTEPS = 4
ROBOTS = 6


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two cameras above the middle of the pollution experiment's arena."""
    directory = tmp_path_factory.mktemp("lab") / "recording"
    make(directory)
    return directory


def make(directory: Path, timesteps: int = TIMESTEPS) -> None:
    experiment = load("pollutant")
    experiment = replace(experiment, robots=experiment.robots[:ROBOTS])
    cameras = tuple(
        Camera.looking_down(f"cam_{k}", 0.5 * k - 0.25, 0.0, 2.43, 800.0, (1000, 900))
        for k in range(2)
    )
    spec = replace(spec_for(experiment, "", 5, Path()), cameras=cameras)
    record(experiment, directory, timesteps, 5, spec=spec)


def track(
    capsys: pytest.CaptureFixture[str], folder: Path, *arguments: str
) -> tuple[int, str, str]:
    names = [str(folder / name) for name in ("resources.xml", "experiment.xml")]
    code = main(["track", *names, *arguments])
    out, err = capsys.readouterr()
    return code, out, err


def truth(folder: Path) -> dict[tuple[int, int], tuple[float, float, float]]:
    with (folder / "truth.csv").open() as file:
        return {
            (int(row["timestep"]), int(row["tag"])): (
                float(row["x_m"]), float(row["y_m"]), float(row["yaw_rad"]),
            )
            for row in csv.DictReader(file)
        }  # fmt: skip


def test_a_recording_is_tracked_to_where_the_robots_truly_were(
    recording: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, err = track(capsys, recording, "--offline")
    states = [json.loads(line) for line in out.splitlines()]
    assert code == 0
    assert [state["timestep"] for state in states] == list(range(TIMESTEPS))
    assert f"{TIMESTEPS} timesteps, {2 * TIMESTEPS} pictures in" in err
    true = truth(recording)
    seen = 0
    for state in states:
        for robot in (r for r in state["robots"] if r["seen"]):
            x_m, y_m, yaw_rad = true[state["timestep"], robot["tag"]]
            assert np.hypot(robot["x_m"] - x_m, robot["y_m"] - y_m) < 0.003
            assert abs(np.angle(np.exp(1j * (robot["yaw_rad"] - yaw_rad)))) < np.radians(2.0)
            seen += 1
    assert seen >= TIMESTEPS * 3


def test_robots_drive(recording: Path) -> None:
    true = truth(recording)
    tags = {tag for _, tag in true}
    ways = [np.hypot(*np.subtract(true[3, tag][:2], true[0, tag][:2])) for tag in tags]
    assert len(tags) == ROBOTS + 1 and sum(way > 0.01 for way in ways) >= 3


def test_the_same_seed_gives_the_same_bytes(recording: Path, tmp_path: Path) -> None:
    make(tmp_path / "again", 2)
    for picture in ("cam_0/000001.png", "cam_1/000000.png"):
        one, two = (p / "pictures" / picture for p in (recording, tmp_path / "again"))
        assert one.read_bytes() == two.read_bytes()


def test_csv_frames_and_snapshot(
    recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    picture = tmp_path / "state.png"
    arguments = ("--offline", "--format", "csv", "--frames", "2", "--snapshot", str(picture))
    code, out, err = track(capsys, recording, *arguments)
    rows = list(csv.DictReader(out.splitlines()))
    assert code == 0 and {row["timestep"] for row in rows} == {"0", "1"}
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert "2 timesteps, 4 pictures" in err


def test_a_damaged_recording_is_tracked_as_far_as_it_goes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    make(tmp_path / "r")
    first, second, third, _ = sorted((tmp_path / "r" / "pictures" / "cam_0").glob("*.png"))
    first.write_bytes(first.read_bytes()[:5000])
    second.unlink()
    third.write_bytes(b"")
    code, out, err = track(capsys, tmp_path / "r", "--offline")
    assert code == 0 and len(out.splitlines()) == TIMESTEPS
    for words in ("000000.png is cut off after 5000 bytes", "000001.png cannot be read: No such",
                  "000002.png is empty"):  # fmt: skip
        assert f"vsense: camera cam_0: {words}" in err


def test_the_pictures_are_kept_where_the_experiment_asks_for_it(
    recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (recording / "experiment.xml").read_text()
    wanted = f'change_root_directory_on_start="false" root_directory="{tmp_path}/kept"'
    text = text.replace('record_image="false"', f'record_image="true" {wanted}')
    (recording / "keeping.xml").write_text(text)
    arguments = ["track", str(recording / "resources.xml"), str(recording / "keeping.xml")]
    assert main([*arguments, "--offline"]) == 0
    out = capsys.readouterr().out
    assert track(capsys, tmp_path / "kept", "--offline")[1] == out
    assert main([*arguments, "--offline"]) == 2
    assert "holds a recording already" in capsys.readouterr().err


def test_the_shipped_example_works_on_a_recording(
    recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from importlib import resources

    for name in ("resources.xml", "experiment.xml"):
        text = (resources.files("vsense.config") / "examples" / name).read_text()
        # The test's recording has two cameras; the example's session has four.
        lines = text.splitlines(keepends=True)
        absent = [x for x in lines if "<camera_state" in x and "recorded_" in x and '_1" cam' in x]
        text = "".join(line for line in lines if line not in absent)
        (tmp_path / name).write_text(text.replace("cam_0_0", "cam_0").replace("cam_1_0", "cam_1"))
    (tmp_path / "recording").symlink_to(recording)
    code, out, err = track(capsys, tmp_path, "--offline", "--frames", "1")
    assert code == 0, err
    assert json.loads(out)["detected"] >= 3


@pytest.mark.parametrize(
    "change, words",
    [
        (
            ('tracker="robots"', 'tracker="robot"'),
            "experiment.xml:6: <camera_state_tracker> tracker:",
        ),
        (("<camera_state_tracker", "<camera"), "does not belong in <arena_state_tracker>"),
    ],
)
def test_a_wrong_file_is_one_line_and_exit_code_2(
    recording: Path, capsys: pytest.CaptureFixture[str], change: tuple[str, str], words: str
) -> None:
    text = (recording / "experiment.xml").read_text()
    wrong = recording / "wrong"
    wrong.mkdir(exist_ok=True)
    (wrong / "experiment.xml").write_text(text.replace(*change, 1))
    got = main(["track", str(recording / "resources.xml"), str(wrong / "experiment.xml")])
    out, err = capsys.readouterr()
    assert got == 2 and out == ""
    assert len(err.splitlines()) == 1 and words in err
