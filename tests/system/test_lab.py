"""The whole lab with a few robots: real processes, real sockets, real signals."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from tests.rigs.places import ROOT
from tests.rigs.processes import PATIENCE_S, Lab, descendants
from tests.robots.link.legacy_rig import Client
from vsense.modes.lab._microcontrollers import read_actuations
from vsense.modes.lab.hardware import BASE_KINDS
from vsense.modes.lab.truth import read_truth
from vsense.monitor.recording.reader import open_recording
from vsense.world.robot_models import model_of

pytestmark = pytest.mark.system

KEYS = {
    "experiment", "seed", "robots", "cameras", "timesteps", "late_timesteps",
    "left_out_timesteps", "duration_s", "tracking", "latency_ms", "sensing", "clock", "swarm",
    "link", "vision",
}  # fmt: skip


@pytest.fixture
def directory(tmp_path: Path) -> Iterator[Path]:
    yield tmp_path / "run"


def start(directory: Path, *arguments: str) -> Lab:
    return Lab(directory, "pollutant", "--port", "0", "--robots", "3", *arguments)


def last_speeds(directory: Path) -> dict[int, tuple[int, int]]:
    """The last motor command that each microcontroller applied."""
    rows = read_actuations(directory / "actuations.bin")
    return {int(r["robot"]): (int(r["left_steps_s"]), int(r["right_steps_s"])) for r in rows}


def test_short_run_measures_everything_and_leaves_nothing_behind(directory: Path) -> None:
    lab = start(directory, "--duration", "4", "--seed", "7", "--json", "--legacy-port", "0")
    said = lab.wait_for(r"original client on port \d+\n")
    watching = Client(int(re.findall(r"port (\d+)", said)[0]), 1)
    watching.start()
    assert lab.end() == 0, "".join(lab.said)
    learnt = watching.finish()
    assert learnt.table == {7: 12} and learnt.started and learnt.ended
    assert learnt.values[7] in ((0.0,), (1.0,)), "robot 1 of three, on 127.0.0.1"
    summary = json.loads("".join(lab.printed))
    assert summary.keys() >= KEYS
    assert summary == lab.summary()
    assert (summary["robots"], summary["cameras"], summary["timesteps"]) == (3, 4, 40)
    assert summary["tracking"]["wrong_ids"] == 0
    assert summary["tracking"]["detected_mean"] > 3.9
    assert summary["tracking"]["position_rmse_mm"] < 2.0
    assert summary["sensing"]["expected"] == 120
    # Nothing is lost here; a first STATE over TCP that a datagram overtook is dropped as old.
    link = summary["link"]
    assert link["received"] + link["dropped"] >= link["sent"] > 0
    assert link["sent"] - link["received"] <= 3, "at most the first one of each robot"
    assert (directory / "pollutant.png").stat().st_size > 100_000
    assert last_speeds(directory) == {0: (0, 0), 1: (0, 0), 2: (0, 0)}
    assert lab.relatives() == {}


def test_a_slow_lab_of_six_cameras(directory: Path) -> None:
    """All clocks go at half speed: the run has all its timesteps, in twice the time."""
    lab = start(directory, "--cameras", "3x2", "--pace", "0.5", "--duration", "2", "--json")
    lab.wait_for(r"6 cameras, 2\.43 m high, pictures of 1620 x 1220 pixels")
    begun_s = time.monotonic()
    assert lab.end() == 0, "".join(lab.said)
    assert time.monotonic() - begun_s > 0.95 * 2.0 / 0.5
    summary = lab.summary()
    assert (summary["cameras"], summary["pace"], summary["timesteps"]) == (6, 0.5, 20)
    assert summary["sensing"]["readings"] == summary["sensing"]["expected"] == 60
    assert summary["tracking"]["detected_mean"] > 3.9
    assert any("pace      0.5" in line for line in lab.said)


def test_a_mixed_swarm_on_mixed_bases(directory: Path) -> None:
    """Four predators and two prey on four kinds of base: each has its own daemon and table."""
    words = ("--port", "0", "--robots", "6", "--base", "mixed", "--duration", "3", "--record")
    lab = Lab(directory, "predator_prey", *words)
    assert lab.end() == 0, "".join(lab.said)
    assert not any("nobody offers" in line for line in lab.said)
    summary = lab.summary()
    assert summary["robots"] == 6 and summary["measures"]["prey_caught"] >= 0.0
    assert summary["sensing"]["readings"] > 0.9 * summary["sensing"]["expected"]
    with open_recording(next(directory.glob("*.mcap"))) as recording:
        *_, robots = recording.messages({"/robots"})
    assert robots.data["controller"] == robots.data["expected"] == ["predator"] * 4 + ["prey"] * 2
    assert len(set(robots.data["hash"])) == 2
    assert [len(values) for values in robots.data["actuators"]] == [1] * 4 + [2] * 2


FOOTBOT_M = model_of("footbot").radius_m
KINDS = {
    # tag: base in the roster, model, radius [m], start: x, y [m], heading
    31: ("argos:/dev/ttyS0", "epuck", 0.035, (-0.4, 0.0, 0)),
    71: ("wifi:192.168.1.40", "epuck2", 0.035, (0.0, 0.4, -90)),
    1843: ("exec:thymio /dev/ttyACM0", "thymio2", 0.08, (0.4, 0.0, 180)),
    4334: ("exec:ros2 --namespace robot_4334", "cart", 0.12, (0.0, -0.45, 90)),
    7167: ("argos:/dev/ttyS0", "footbot", FOOTBOT_M, (0.45, 0.45, -135)),
}
MEETING = """<argos-configuration xmlns:vs="urn:vsense:1">
<framework><experiment length="60" ticks_per_second="10" random_seed="1" /></framework>
<controllers>{controllers}</controllers>
<arena size="1.6,1.6,1" center="0,0,0.5">{robots}</arena></argos-configuration>
"""
CONTROLLER = """<m_controller id="{model}" library="meets.py"><actuators>
<differential_steering implementation="default" /></actuators><sensors /><params />
</m_controller>"""
ROBOT = """<e-puck id="{model}" vs:tag="{tag}" vs:model="{model}">
<body position="{x},{y},0" orientation="{heading},0,0" /><controller config="{model}" /></e-puck>"""
CART = """[body]
radius_m = 0.12
height_m = 0.1
marker_height_m = 0.11
mass_kg = 3.0
[wheels]
axle_m = 0.2
diameter_m = 0.041
steps_per_turn = 1000
max_steps_s = 2000
acceleration_m_s2 = 1.0
[ring]
places_m = [[0.12, 0.0]]
headings_deg = [0.0]
half_cone_deg = 10.0
table_m = [0.0, 0.2, 0.21]
table_raw = [4000.0, 1000.0, 0.0]
noise_raw = 1.0
"""


@pytest.mark.paced
def test_kinds_of_robots_with_bases_of_their_own_meet(directory: Path, tmp_path: Path) -> None:
    """E-pucks by cable and Wi-Fi, a Thymio, a ROS 2 robot and a foot-bot run into each other."""
    pytest.importorskip("thymiodirect", reason="pip install vsense[thymio]")
    pytest.importorskip("cyclonedds", reason="pip install vsense[ros2]")
    (tmp_path / "cart.toml").write_text(CART)
    (tmp_path / "meets.py").write_text(
        "class Controller:\n"
        "    def __init__(self, robot): pass\n"
        "    def step(self, robot): robot.set_wheels(600, 600)\n"
    )
    rows = [(t, base, model, *start) for t, (base, model, _, start) in KINDS.items()]
    tables = "".join(f'[[robot]]\ntag = {tag}\nbase = "{base}"\n' for tag, base, *_ in rows)
    (tmp_path / "robots.toml").write_text(tables)
    text = MEETING.format(
        controllers="".join(CONTROLLER.format(model=row[2]) for row in rows),
        robots="".join(
            ROBOT.format(tag=tag, model=model, x=x, y=y, heading=heading)
            for tag, _, model, x, y, heading in rows
        ),
    )
    (tmp_path / "meeting.argos").write_text(text)
    words = ("--roster", str(tmp_path / "robots.toml"), "--port", "0", "--duration", "10")
    lab = Lab(directory, str(tmp_path / "meeting.argos"), *words)
    assert lab.end() == 0, "".join(lab.said)
    tracking = lab.summary()["tracking"]
    assert tracking["wrong_ids"] == 0 and tracking["detected_mean"] > 3.9  # type: ignore[index]
    poses = read_truth(directory / "truth.bin")["poses"]
    ways_m = np.hypot(*np.diff(poses[:, :, :2], axis=0).T).sum(axis=1)
    assert (ways_m > 0.2).all(), "each has a base that turns its wheels"
    radii_m = [radius for _, _, radius, _ in KINDS.values()]
    gaps_m = {
        (i, j): np.hypot(*(poses[:, i, :2] - poses[:, j, :2]).T).min() - (radii_m[i] + radii_m[j])
        for i, j in combinations(range(len(radii_m)), 2)
    }
    print(gaps_m)
    assert min(gaps_m.values()) > -1e-4
    met = [(radii_m[i], radii_m[j]) for (i, j), gap_m in gaps_m.items() if gap_m < 1e-4]
    assert sum(one != other for one, other in met) >= 3, "bodies of different size touch"


@pytest.mark.paced
def test_blind_robots_hold_zero(directory: Path) -> None:
    lab = start(directory, "--duration", "3", "--blind", "--home")
    lab.wait_for("3 of 3 robots stand at their starts after ")
    assert lab.end() == 0, "".join(lab.said)
    held = set()
    for trace in (directory / "robots").glob("*.trace"):
        held |= set(re.findall(r"pollutant=([0-9a-f]+)", trace.read_text()))
    assert held == {"00000000"}
    assert lab.printed == [], "without --json standard output stays empty"


@pytest.mark.paced
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_interrupted_run_stops_wheels_and_still_reports(directory: Path, number: int) -> None:
    lab = start(directory, "--duration", "600")
    lab.wait_for("timestep \\d")
    lab.process.send_signal(number)
    assert lab.end() == 128 + number
    assert lab.relatives() == {}
    assert set(last_speeds(directory).values()) == {(0, 0)}
    if number == signal.SIGTERM and "no time for the figures" in "".join(lab.said):
        return  # a machine that is busy, where 2 s are all that SIGTERM leaves
    assert lab.summary()["timesteps"] > 0
    assert (directory / "pollutant.png").is_file()


@pytest.mark.paced
def test_killed_daemon_is_named_and_joins_again(directory: Path) -> None:
    lab = start(directory, "--duration", "600")
    lab.wait_for("timestep \\d")
    tag = int(next((directory / "robots").glob("*.sh")).stem)
    os.kill(lab.daemon(tag), signal.SIGKILL)
    told = lab.wait_for("was killed by SIGKILL .*the experiment goes on")
    script = Path(told.split("start it again with ")[1].strip())
    assert script.stem == str(tag)
    again = subprocess.Popen([script], start_new_session=True, stderr=subprocess.DEVNULL)
    lab.wait_for(f"(?i){tag}.*(reconnected|connected again|back)")
    lab.process.send_signal(signal.SIGINT)
    assert lab.end() == 130
    again.wait(PATIENCE_S)
    assert lab.relatives() == {}
    assert lab.summary()["link"]["reconnects"] >= 1


@pytest.mark.paced
@pytest.mark.parametrize(
    ("process", "told"), [("_physics_process", "physics"), ("_cameras", "cameras")]
)
def test_failing_process_is_named_and_the_run_reported(
    directory: Path, process: str, told: str
) -> None:
    lab = start(directory, "--duration", "600")
    lab.wait_for("timestep \\d")
    (pid,) = [
        pid for pid, command in lab.relatives().items() if f"vsense.modes.lab.{process}" in command
    ]
    os.kill(pid, signal.SIGKILL)
    assert lab.end() == 1
    assert f"{told} was killed by SIGKILL" in lab.said[-1]
    assert lab.relatives() == {}
    if told == "cameras":
        assert lab.summary()["timesteps"] > 0


@pytest.mark.paced
def test_loop_functions_that_crash_end_the_run_in_order(directory: Path, tmp_path: Path) -> None:
    here = ROOT / "tests" / "run" / "argos"
    shutil.copy2(here / "mission.cpp", tmp_path)
    text = (here / "mission.argos").read_text()
    params = 'fails_in="PostStep" fails_from="6" how="crash"'
    (tmp_path / "mission.argos").write_text(text.replace('edge="0.0" end="0"', params))
    lab = Lab(directory, str(tmp_path / "mission.argos"), "--port", "0", "--record")
    assert lab.end() == 1
    assert (
        lab.said[-1].strip()
        == "vsense: loop functions 'mission' (mission.cpp): PostStep was killed by SIGSEGV"
    )
    assert lab.relatives() == {}
    # In the sixth timestep, unless a busy machine has left some out.
    assert 0 < lab.summary()["timesteps"] <= 5  # type: ignore[operator]
    with open_recording(directory / "mission.mcap") as recording:
        assert recording.complete
        events = [message.data for message in recording.messages({"/event"})]
    assert lab.said[-1].strip().removeprefix("vsense: ") in [
        event["text"] for event in events if event["level"] == "trouble"
    ]


@pytest.mark.paced
def test_earlier_run_is_never_written_over(directory: Path) -> None:
    lab = start(directory, "--duration", "2")
    assert lab.end() == 0
    before = lab.summary()
    again = start(directory, "--duration", "2")
    assert again.end() == 2
    assert "is not empty: choose a new folder" in again.said[-1]
    assert lab.summary() == before


@pytest.mark.paced
def test_closed_outputs_cost_no_measurement(directory: Path) -> None:
    command = [sys.executable, "-m", "vsense", "lab", "pollutant", "--robots", "2", "--port", "0"]
    command += ["--duration", "2", "--output", str(directory)]
    result = subprocess.run(["sh", "-c", 'exec "$@" >&- 2>&-', "sh", *command], timeout=PATIENCE_S)
    assert result.returncode == 0
    summary = json.loads((directory / "summary.json").read_text())
    assert summary["timesteps"] + summary["left_out_timesteps"] == 20


@pytest.mark.paced
def test_killed_host_leaves_no_process(directory: Path) -> None:
    """Whatever robots are based on: a driver and a radio are there when the lab is not."""
    count = len(BASE_KINDS)
    lab = Lab(
        directory, "pollutant", "--port", "0", "--robots", f"{count}", *("--base", "mixed"),
        *("--duration", "600"),
    )  # fmt: skip
    lab.wait_for("timestep \\d")
    relatives = descendants(lab.process.pid)
    drivers = [n for n in relatives if b"epuck.py" in Path(f"/proc/{n}/cmdline").read_bytes()]
    # its daemon's two name it, too; 2 processes each, the driver, cameras, physics
    assert len(drivers) == 3 and len(relatives) >= 2 * count + 3
    descriptors = [os.pidfd_open(pid) for pid in relatives]
    lab.process.kill()
    lab.end()
    for descriptor in descriptors:
        ended = threading.Event()
        waiter = threading.Thread(target=_wait_for_end, args=(descriptor, ended), daemon=True)
        waiter.start()
        assert ended.wait(PATIENCE_S), lab.relatives()


def _wait_for_end(descriptor: int, ended: threading.Event) -> None:
    import select

    select.select([descriptor], [], [])
    ended.set()


def fails(tmp_path: Path, *arguments: str, **variables: str) -> tuple[int, str]:
    """Exit code and stderr of a command that must not start."""
    result = subprocess.run(
        [sys.executable, "-m", "vsense", "lab", *arguments],
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        env={**os.environ, **variables},
    )
    assert result.stdout == ""
    assert "Traceback" not in result.stderr
    return result.returncode, result.stderr


@pytest.mark.quick
def test_unknown_experiment_tells_which_may_be_meant(tmp_path: Path) -> None:
    code, said = fails(tmp_path, "polutant")
    assert code == 2
    assert re.fullmatch(r"vsense: no experiment 'polutant': .*; is 'pollutant' or .*\n", said)


@pytest.mark.quick
def test_broken_file_is_named_with_its_line(tmp_path: Path) -> None:
    from importlib import resources

    text = (resources.files("vsense") / "config/experiments/pollutant.argos").read_text()
    broken = tmp_path / "broken.argos"
    broken.write_text(text.replace('wide_angle="90"', 'wide_angle="wide"'))
    line = text[: text.index("<virtual_pollutant_sensor")].count("\n") + 1
    code, said = fails(tmp_path, str(broken))
    assert code == 2
    assert re.search(rf"broken\.argos:{line}: .*'wide' is not a number", said), said


@pytest.mark.quick
def test_port_in_use_is_one_line(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        arguments = ("pollutant", "--port", port, "--output", str(tmp_path / "run"))
        code, said = fails(tmp_path, *arguments)
    assert code == 1
    assert port in said and len(said.strip().splitlines()) == 1, said


@pytest.mark.quick
def test_unwritable_directory_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    code, said = fails(tmp_path, "pollutant", "--output", str(tmp_path / "file" / "run"))
    assert code == 2
    assert "Not a directory" in said and len(said.strip().splitlines()) == 1


@pytest.mark.parametrize(
    "arguments", [("--duration", "nan"), ("--duration", "0"), ("--seed", "-1"), ("--robots", "0")]
)
@pytest.mark.quick
def test_wrong_arguments_exit_with_2(tmp_path: Path, arguments: tuple[str, str]) -> None:
    code, said = fails(tmp_path, "pollutant", *arguments, "--output", str(tmp_path / "run"))
    assert code == 2
    assert arguments[1] in said


@pytest.mark.paced
@pytest.mark.parametrize("delay_s", [1.0, 1.3, 1.6])
def test_sigterm_ends_the_start_at_once(directory: Path, delay_s: float) -> None:
    """It comes while the lab opens what it needs, which takes longer than these delays."""
    lab = Lab(directory, "pollutant", "--port", "0")
    with pytest.raises(subprocess.TimeoutExpired):
        lab.process.wait(delay_s)
    lab.process.terminate()
    assert lab.end() in (143, -signal.SIGTERM), "before Python has a handler the system ends it"
    assert not any("Traceback" in line for line in lab.said)
    assert lab.relatives() == {}
