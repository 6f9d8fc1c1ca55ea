"""The camera process end to end: pictures, log, and every way it can end."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.rigs.places import ROOT
from vsense.base.clock import host_ns
from vsense.base.errors import GrabberError
from vsense.base.shared import BANK_SLOTS, LabError
from vsense.modes.lab._backdrop import Block
from vsense.modes.lab._bodies import Body
from vsense.modes.lab._camera_spec import LabCameraSpec, rig
from vsense.modes.lab._cameras import Input
from vsense.modes.lab._grabber import LabGrabber
from vsense.modes.lab._optics import SAMPLES, sample_times_ns
from vsense.modes.lab._renderer import Studio
from vsense.modes.lab.truth import TruthReader, TruthWriter, make_ring, read_truth
from vsense.vision.cameras.camera import Camera
from vsense.world.entities import Arena

PATIENCE_S = 20.0
TIMESTEP_NS = 20_000_000
BODIES = (Body(31, 0.06), Body(52447, 0.05, "object"))
SECOND_NS = 1_000_000_000

ORPHAN = """
import sys
from pathlib import Path
from vsense.modes.lab._camera_spec import LabCameraSpec
from vsense.base.shared import BANK_SLOTS
from vsense.modes.lab._grabber import LabGrabber

grabber = LabGrabber(LabCameraSpec.from_json(sys.stdin.readline()))
grabber.start(int(sys.argv[1]))
print(grabber.pid, flush=True)
sys.stdin.readline()
"""


def small_cameras() -> tuple[Camera, ...]:
    return tuple(
        Camera.looking_down(
            f"cam_{k}", 0.2 * k, 0.0, 2.43, 800.0, (160, 120), (-0.12, 0.02, 0, 0, 0)
        )
        for k in range(2)
    )


@pytest.fixture
def spec(tmp_path: Path) -> Iterator[LabCameraSpec]:
    """Two small cameras over a robot that slowly turns and a thing that stands."""
    ring = make_ring(len(BODIES))
    writer = TruthWriter(ring.name, len(BODIES))
    now_ns = host_ns()
    for when_ns, turn in ((now_ns - 100 * SECOND_NS, 0.0), (now_ns + 1000 * SECOND_NS, 3.0)):
        poses = np.array([(0.1, 0.02, turn), (0.0, -0.05, 1.0)])
        writer.write(when_ns, poses, np.array([0xFF, 0]))
    yield LabCameraSpec(
        cameras=small_cameras(),
        boxes=(Block(0.1, 0.12, 0.0, 0.3, 0.02, 0.05),),
        bodies=BODIES,
        family="arrow4x4",
        timestep_ns=TIMESTEP_NS,
        truth=ring.name,
        log=tmp_path / "truth.bin",
        seed=5,
        frames=6,
    )
    ring.close()


@contextmanager
def running(spec: LabCameraSpec) -> Iterator[LabGrabber]:
    grabber = LabGrabber(spec)
    try:
        yield grabber
    finally:
        grabber.close()


def soon_ns() -> int:
    return host_ns() + SECOND_NS // 10


def hours_away_ns() -> int:
    return host_ns() + 7200 * SECOND_NS


def wait_for_end(pid: int) -> None:
    """Waits until a process that need not be a child has ended."""
    try:
        process = os.pidfd_open(pid)
    except ProcessLookupError:
        return
    assert select.select([process], [], [], PATIENCE_S)[0], "the camera process lives on"
    os.close(process)


def test_pictures_come_as_triggered_and_as_the_studio_draws_them(spec, capfd) -> None:
    spec = replace(spec, frames=BANK_SLOTS)  # no slot is used twice, however slow this test is
    epoch_ns = soon_ns()
    studio, truth = Studio(spec), TruthReader(spec.truth)
    expected = np.empty(spec.shape, dtype=np.uint8)
    with running(spec) as grabber:
        grabber.start(epoch_ns)
        seen = []
        with pytest.raises(GrabberError, match="have taken their last picture"):
            while True:
                frames = grabber.next(PATIENCE_S)
                seen.append(frames[0].timestep)
                for camera, frame in zip(spec.cameras, frames):
                    assert frame.camera == camera.id
                    assert frame.capture_ns == epoch_ns + frame.timestep * TIMESTEP_NS
                    assert frame.ready_ns > frame.capture_ns
                moments = sample_times_ns(frames[0].capture_ns, SAMPLES)
                poses, leds = zip(*(truth.at(moment) for moment in moments))
                studio.prepare(frames[0].timestep, expected)
                studio.expose(frames[0].timestep, np.array(poses), leds[1], expected)
                assert np.array_equal([frame.image for frame in frames], expected)
                assert grabber.exposure is not None
    assert seen == sorted(set(seen)) and seen
    log = read_truth(spec.log)
    assert set(seen) <= set(log["timestep"].tolist())
    for row in log:
        assert row["capture_ns"] == epoch_ns + row["timestep"] * TIMESTEP_NS
        assert np.array_equal(row["poses"], truth.at(int(row["capture_ns"]))[0])
        assert row["leds"].tolist() == [0xFF, 0]
    assert capfd.readouterr().err == ""


def test_the_newest_pictures_win(spec: LabCameraSpec) -> None:
    with running(spec) as grabber:
        grabber.start(soon_ns())
        wait_for_end(grabber.pid)
        frames = grabber.next(PATIENCE_S)
        log = read_truth(spec.log)
        assert frames[0].timestep == log["timestep"][-1]
        assert grabber.missed == len(log) - 1


def test_the_first_call_starts_the_cameras_just_after_the_newest_truth(spec: LabCameraSpec) -> None:
    ring = make_ring(len(BODIES))
    writer = TruthWriter(ring.name, len(BODIES))
    start_ns = host_ns()
    writer.write(start_ns, np.zeros((2, 3)), np.zeros(2, dtype=int))
    with running(replace(spec, truth=ring.name)) as grabber:
        with pytest.raises(GrabberError, match="no pictures from the lab's 2 cameras in 0 s"):
            grabber.next(0.0)
        writer.write(start_ns + 100 * SECOND_NS, np.zeros((2, 3)), np.zeros(2, dtype=int))
        frames = grabber.next(PATIENCE_S)
    since_ns = frames[0].capture_ns - start_ns - frames[0].timestep * TIMESTEP_NS
    assert since_ns % 10_000_000 == 5_000_000


def test_end_of_input_ends_it_in_the_middle_of_waiting(spec: LabCameraSpec) -> None:
    with running(spec) as grabber:
        grabber.start(hours_away_ns())
    assert grabber._process.returncode == 0
    assert len(read_truth(spec.log)) == 0
    grabber.close()


def test_sigterm_ends_it_cleanly(spec: LabCameraSpec) -> None:
    with running(spec) as grabber:
        grabber.start(hours_away_ns())
        os.kill(grabber.pid, signal.SIGTERM)
        with pytest.raises(GrabberError, match="have taken their last picture"):
            grabber.next(PATIENCE_S)


def test_a_killed_process_is_a_clear_error(spec: LabCameraSpec) -> None:
    with running(spec) as grabber:
        grabber.start(hours_away_ns())
        os.kill(grabber.pid, signal.SIGKILL)
        with pytest.raises(GrabberError, match="killed by SIGKILL"):
            grabber.next(PATIENCE_S)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"family": "arrow9x9"}, "marker family 'arrow9x9' is not known"),
        ({"bodies": BODIES[:1]}, "truth ring: 2 bodies, the spec has 1"),
        ({"log": Path("/nowhere/truth.bin")}, "truth log /nowhere/truth.bin: No such file"),
        ({"truth": "no-such-ring"}, "shared memory no-such-ring: nobody has made it"),
    ],
)
def test_a_spec_that_cannot_be_followed_is_one_clear_line(spec, change, reason, capfd) -> None:
    expected = "ended with exit code 1; what it said stands above"
    with (
        running(replace(spec, **change)) as grabber,
        pytest.raises(GrabberError, match=expected),
    ):
        grabber.next(PATIENCE_S)
    said = capfd.readouterr().err
    assert said.startswith(f"cameras: {reason}") and said.count("\n") == 1


def test_nothing_is_left_when_the_host_is_killed(spec: LabCameraSpec) -> None:
    before = set(os.listdir("/dev/shm"))
    command = [sys.executable, "-c", ORPHAN, str(hours_away_ns())]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, cwd=ROOT, text=True) as host:
        assert host.stdin is not None and host.stdout is not None
        host.stdin.write(spec.to_json() + "\n")
        host.stdin.flush()
        cameras = int(host.stdout.readline())
        host.kill()
    wait_for_end(cameras)
    assert not [name for name in set(os.listdir("/dev/shm")) - before if "frames" in name]


def test_spec_survives_its_line(spec: LabCameraSpec) -> None:
    assert LabCameraSpec.from_json(spec.to_json()) == spec
    with pytest.raises(LabError, match="camera spec"):
        LabCameraSpec.from_json('{"cameras": []}')
    with pytest.raises(LabError, match="one size"):
        replace(spec, cameras=())


@pytest.mark.parametrize("size", [(1.0, 1.0), (3.0, 2.4), (4.3, 3.1)])
def test_rig_sees_the_whole_arena_and_overlaps(size: tuple[float, float]) -> None:
    arena = Arena((*size, 1.0), (0.4, -0.3, 0.5))
    cameras = rig(arena)
    assert [camera.id for camera in cameras] == ["cam_0_0", "cam_1_0", "cam_0_1", "cam_1_1"]
    rng = np.random.default_rng(1)
    places = np.array(arena.centre_m[:2]) + rng.uniform(-0.5, 0.5, (5000, 2)) * size
    markers = np.column_stack((places, np.full(len(places), 0.06)))
    margin_px = 0.035 * 1620 / 2.37
    seen = [camera.contains(camera.project(markers), margin_px) for camera in cameras]
    beyond = np.abs(places - arena.centre_m[:2]) > np.array(size) / 2 - 0.035
    assert np.any(seen, axis=0)[~beyond.any(axis=1)].all()


def test_the_highest_marker_is_whole_in_a_picture_wherever_it_is() -> None:
    arena, rng = Arena((3.0, 3.0, 1.0), (0.0, 0.0, 0.5)), np.random.default_rng(1)
    places = rng.uniform(-1.45, 1.45, (5000, 2))
    markers = np.column_stack((places, np.full(len(places), 0.42)))
    seen = [c.contains(c.project(markers), 30.0) for c in rig(arena, None, 0.42)]
    assert np.any(seen, axis=0).all()
    assert not np.any([c.contains(c.project(markers), 30.0) for c in rig(arena)], axis=0).all()


@pytest.mark.parametrize(
    ("size", "grid", "found"),
    [
        ((6.0, 2.0), None, (3, 2)),
        ((8.0, 8.0), None, (4, 5)),
        ((8.0, 8.0), (4, 4), (4, 4)),
        ((3.0, 2.4), (1, 1), (1, 1)),
    ],
)
def test_a_large_arena_gets_more_cameras_or_higher_ones(
    size: tuple[float, float], grid: tuple[int, int] | None, found: tuple[int, int]
) -> None:
    arena = Arena((*size, 1.0), (1.0, 2.0, 0.5))
    cameras = rig(arena, grid)
    assert len(cameras) == found[0] * found[1]
    assert cameras[-1].id == f"cam_{found[0] - 1}_{found[1] - 1}"
    rng = np.random.default_rng(1)
    places = np.array(arena.centre_m[:2]) + rng.uniform(-0.5, 0.5, (5000, 2)) * size
    markers = np.column_stack((places, np.full(len(places), 0.06)))
    seen = [camera.contains(camera.project(markers), 10.0) for camera in cameras]
    assert np.any(seen, axis=0).all()
    x_m, y_m, _ = cameras[0].position_m
    decimetre = cameras[0].project(np.array([[x_m, y_m, 0.0], [x_m + 0.1, y_m, 0.0]]))
    assert np.linalg.norm(np.diff(decimetre, axis=0)) == pytest.approx(100.0 / 1.5, rel=0.01)


def test_rig_refuses_an_arena_that_is_too_large() -> None:
    with pytest.raises(LabError, match=r"arena of 100 x 20 m: 45 x 13 cameras are too many: .* 64"):
        rig(Arena((100.0, 20.0, 1.0), (0.0, 0.0, 0.5)))
    with pytest.raises(LabError, match=r"8 x 8 m: 1 x 1 cameras would have to hang 10\.7 m high"):
        rig(Arena((8.0, 8.0, 1.0), (0.0, 0.0, 0.5)), (1, 1))


def test_lines_are_read_while_nobody_waits_for_them() -> None:
    source, target = os.pipe()
    stdin = Input(source)
    os.write(target, b'{"row": 0}\nhalf')
    assert stdin.wait(0) and stdin.lines() == [b'{"row": 0}'] and stdin.lines() == []
    os.write(target, b" a line\n")
    assert stdin.wait(0) and stdin.lines() == [b"half a line"]
    os.close(target)
    assert not stdin.wait(0)
    os.close(source)
