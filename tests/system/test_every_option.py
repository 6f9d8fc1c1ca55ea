"""Options that no other test passes through the command line, many in each start.

`scripts/test` ends with what nothing passes at all: see `tests/rigs/passed_options.py`.
"""

from __future__ import annotations

import json
import shutil
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from tests.rigs.places import DATA, ROOT
from tests.rigs.processes import Program, free_ports
from tests.rigs.web import page_options
from vsense import cli
from vsense.run.runs_csv import read_runs

pytestmark = pytest.mark.system

PAGE = "--web 127.0.0.1:0 --web-tokens tokens --web-cert page.pem --web-key page-key.pem"
VSENSE = (sys.executable, "-m", "vsense")
SIMULATED = f"{PAGE} --foxglove 0"
WATCHED = f"{SIMULATED} --ros2 77"
OWN_NETWORK = (
    "<CycloneDDS><Domain><General><Interfaces><NetworkInterface name='lo' /></Interfaces>"
    "<AllowMulticast>false</AllowMulticast></General></Domain></CycloneDDS>"
)
"""What ROS 2's DDS may use."""
CODE = "--sources walk=walk.cpp --include inc"
CAST = "--roster swarm.toml --replace 31=99"
ERRORS = "--marker-errors 1,1 --wheel-errors 1 --sensor-errors 5 --robots-seed 9"
SWARM = "--base mixed --firmware-watchdog"
TAGS = (31, 1843, 4334, 7167, 99)
PLAYING = [99, 1843]
"""Tags that play by `CAST`."""
PLAN = """
experiment = "walk.argos"
duration_s = 1
robots.count = 2
robots.home = false
[[condition]]
name = "sighted"
[[start]]
name = "drawn"
seed = 7
[void]
late = 1.0
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """What a lab has: an experiment in C++ for ARGoS, a plan, a roster, a page's files."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "runtime").mkdir(mode=0o700)
    monkeypatch.setenv("CYCLONEDDS_URI", OWN_NETWORK)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "runtime"))
    text = (ROOT / "vsense/config/experiments/foraging.argos").read_text()
    built = '<walk_controller id="ant" library="build/libwalk">'
    text = text.replace('<foraging_controller id="ant" library="foraging">', built)
    text = text.replace("</foraging_controller>", "</walk_controller>")
    Path("walk.argos").write_text(text)
    shutil.copy(ROOT / "vsense/config/experiments/foraging.py", tmp_path)
    shutil.copy(Path(__file__).with_name("walk.cpp"), tmp_path)
    Path("inc").mkdir()
    Path("inc/pace.h").write_text("#define WALK_CM_S 4.0\n")
    rows = [
        f'[[robot]]\ntag = {t}\nhost = "root@{t}"\nspare = {str(t == 99).lower()}' for t in TAGS
    ]
    Path("swarm.toml").write_text("\n".join(rows) + "\n")
    Path("plan.toml").write_text(f'mode = "lab"\n{PLAN}')
    page_options(tmp_path)
    assert vsense("robot keys --new-key --key swarm.key") == 0
    return tmp_path


def vsense(line: str) -> int:
    return cli.main(line.split())


@pytest.fixture
def said(capsys: pytest.CaptureFixture[str]) -> Iterator[Any]:
    """Runs a command in this process; gives what it prints as JSON."""

    def run(line: str, code: int = 0) -> Any:
        capsys.readouterr()
        assert vsense(line) == code, capsys.readouterr().err
        return json.loads(capsys.readouterr().out)

    yield run


@contextmanager
def running(line: str) -> Iterator[Program]:
    """A command that runs; it ends with the block, also where the test has failed."""
    command = Program([*VSENSE, *line.split()])
    try:
        yield command
        if command.process.poll() is None:
            command.process.send_signal(signal.SIGINT)
        assert command.end() in (0, 130), "".join(command.said)
    finally:
        if command.process.poll() is None:
            command.process.kill()  # its own processes end with it: tests/system/test_kills.py
            command.process.wait()


def until(line: str, *patterns: str) -> None:
    """Starts a command, waits for what it says, and ends it by Ctrl-C."""
    with running(line) as command:
        for pattern in patterns:
            command.wait_for(pattern)
        assert command.process.poll() is None, "".join(command.said)


def test_a_lab_takes_all_its_options(folder: Path, said: Any) -> None:
    words = "lab walk.argos --duration 2 --seed 5 --robots 2 --runs 2 --blind --set sensor.noise=0"
    words += f" {CODE} {CAST} {SWARM} {ERRORS} --port 0 --insecure --cameras 2x2"
    words += (
        " --pace 0.9 --radio 99=-70,11 --battery 0.5 --home --home-virtual-walls --hold --locked"
    )
    words += f" --record --record-images --lenient --json -o out {WATCHED}"
    with running(words) as lab:
        for pattern in ("https://.*to-control-it", "Foxglove: ws://", "ready to start: 2 of 2"):
            lab.wait_for(pattern)
        its = f"--process {lab.process.pid} --json"
        assert said(f"control status {its}")["robots"]["tag"] == PLAYING
        reported = time.monotonic() + 20  # a robot reads its radio now and then
        while said(f"robot status {its}")["signal_dbm"] != [-70, None]:
            assert time.monotonic() < reported
        assert said(f"control start {its}")["text"]
        lab.wait_for(r"timestep \d")
        for order in ("pause", "start", "stop --emergency", "reset"):
            assert said(f"control {order} {its}")["text"]
    made = json.loads(next(Path("out").rglob("summary.json")).read_text())
    assert (made["seed"], made["blind"]) == (5, True)


def test_robots_are_emulated_measured_and_run(folder: Path, said: Any) -> None:
    port, lines = free_ports(2)
    link = f"--host 127.0.0.1 --port {port} --key swarm.key"
    words = (
        f"robot emulate 2 --experiment walk.argos {CODE} {CAST} {SWARM} {link} --seed 3 -o robots"
    )
    with running(f"{words} --tracker-port {lines}") as robots:
        robots.wait_for("seed 3; logs in")
        assert "--key swarm.key" in robots.wait_for("in another terminal: ")
        words = f"robot link 99,1843 --experiment walk.argos {CODE} {CAST} {link} --wait 20"
        measured = said(f"{words} --for 1 --json")
        assert (measured["experiment"], len(measured["robots"])) == ("walk", 2)
        link = link.replace("127.0.0.1", "0.0.0.0")  # where others' robots could be, too
        words = f"run walk.argos --tracker lines:{lines} {link} {CODE} {CAST} --robots 2"
        words += " --duration 1 --seed 4 --blind --set sensor.noise=0 --lenient --virtual-devices"
        words += " --battery 0.5 --home-virtual-walls --hold --locked --json -o out"
        with running(f"{words} {WATCHED}") as run:
            for pattern in ("https://.*to-control-it", "Foxglove: ws://", "ready to start: 2 of 2"):
                run.wait_for(pattern)
            its = f"--process {run.process.pid} --json"
            for order in ("replace 1843=31", "replace 31=1843"):
                assert said(f"control {order} {its}")["text"]
            assert said(f"control start {its}")["text"]
            run.wait_for("driving home: 0/2")
            assert vsense(f"control handover {its} --force") == 0
            assert run.end() == 130 and "seed 4, 1 s" in "".join(run.said)


def test_cameras_are_calibrated_wherever_there_is_a_lab(folder: Path) -> None:
    for words in ("lab foraging", "series plan.toml", "benchmark --mode lab --quick"):
        until(f"{words} --calibrate --cameras 2x2 -o {words[:3]}", "the board in 1 of")


def test_pretended_cameras_take_all_their_options(folder: Path) -> None:
    port, lines = free_ports(2)
    words = f"camera pretend rig --experiment walk.argos --robots 2 {CODE} {CAST} --seed 3"
    until(f"{words} --port {port} --tracker-port {lines}", f"on port {lines}, which says")
    text = Path("rig/resources.xml").read_text()
    assert f"http://127.0.0.1:{port}/cam_0_0" in text and "31" not in text.partition("tags=")[2]
    # They are there already; the files of others stay as they are.
    until(f"{words} --port {port} --tracker-port {lines}", "it stays as it is")
    other = f"camera pretend rig --experiment foraging --port {port} --tracker-port {lines}"
    assert vsense(other) == 2 and Path("rig/resources.xml").read_text() == text
    assert vsense("robot init --robots 2 --family aruco_4x4_50 --roster own.toml") == 0


def test_series_and_benchmarks_take_all_their_options(folder: Path) -> None:
    port, lines = free_ports(2)
    lab = f"{CAST} {SWARM} {ERRORS} --cameras 2x2 --pace 0.4 --port {port} {WATCHED}"
    kept = f"{CODE} --lenient --locked --record --record-images"
    assert vsense(f"series plan.toml --mode lab -o lab {lab} {kept} --json") == 0
    assert next(Path("lab").rglob("*.mcap")).stat().st_size > 10_000
    link = f"--host 127.0.0.1 --port {port} --tracker lines:{lines} --virtual-devices"
    real = f"{CAST} {link} --target host --no-deploy --sudo --ssh-option Port=9 --other-programs"
    real += " --link-check 0"
    waits = f"port {port}|ready|missing|connected"
    until(f"series plan.toml --mode run -o run {real} {CODE} --key swarm.key {PAGE}", waits)
    until(f"series plan.toml --mode run -o run2 {real} {CODE} --insecure", waits)
    assert vsense(f"series plan.toml --mode sim -o sim {CODE} -j 2 --lenient --allow-upgrade") == 0


@pytest.mark.quick
def test_what_is_simulated_takes_all_its_options(folder: Path, said: Any) -> None:
    words = f"sim walk.argos {CODE} --hold --locked --speed max --insecure {SIMULATED}"
    until(words, "https://.*to-control-it", "Foxglove: ws://")
    made = said(
        f"sim walk.argos {CODE} {CAST} --blind --lenient --duration 1 --robots 2 --json -o one"
    )
    assert (made["blind"], made["robots"]) == (True, 2)
    words = "sim foraging --runs 1 --duration 1 --format svg --style ggplot -o runs.csv"
    assert vsense(words) == 0 and "#E5E5E5".lower() in Path("runs.svg").read_text().lower()
    for command in ("sim", "lab", "run --tracker lines"):
        name, *more = command.split()
        told = said(" ".join((name, "foraging", *more, "--dry --strict --json")))
        assert told["experiment"] == "foraging"


@pytest.mark.quick
def test_comparisons_and_searches_take_all_their_options(folder: Path, said: Any) -> None:
    how = "--duration 1 --seed 3 --set foraging.pull=0.2 --lenient --format svg --style ggplot"
    told = said(f"compare foraging foraging --minimize robots_carrying --margin 5% {how} --json")
    assert (told["verdict"], told["margin"], told["pairs"]) == ("not worse", 0.05, 8)
    searched = "--vary foraging.release=0,1 --minimize robots_carrying --runs 1 --trials 2"
    told = said(f"optimize foraging {searched} {how} --json")
    assert {trial["settings"]["foraging.release"] for trial in told["trials"]} == {"0", "1"}
    for table in Path("runs").glob("*.csv"):
        assert {row.seed for row in read_runs(table)} in ({3}, {*range(3, 11)})
        assert "#e5e5e5" in table.with_suffix(".svg").read_text().lower()
    assert len([*Path("runs").glob("*.csv")]) == 2


@pytest.mark.quick
@pytest.mark.parametrize(
    "command", ["sim", "lab", "run", "render", "robot calibrate", "robot check", "optimize"]
)
def test_shipped_experiments_are_listed(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        vsense(f"{command} --list")
    assert ended.value.code == 0 and "foraging\n" in capsys.readouterr().out


def test_robots_are_checked_and_calibrated_with_all_options(folder: Path) -> None:
    port = free_ports(1)[0]
    lab = f"--lab {SWARM} {ERRORS} --pace 0.9 --robots 2 --seed 3 --port {port} --wait 30 --json"
    faults = "--swap-markers 31=1843 --dead-motors 1843"
    words = f"robot check foraging {lab} --wiggle {faults} -o checked --roster swarm.toml {PAGE}"
    until(words, "https://.*to-control-it")
    sensors = "--sensors proximity,ground --wall wall_north --white 0.5,0.5 --black -0.5,-0.5"
    lab = lab.replace("mixed", "york")
    words = f"robot calibrate foraging {lab} {sensors} -o calibrated --roster swarm.toml {PAGE}"
    until(words, "https://.*to-control-it")
    assert vsense("camera render foraging seen --frames 3 --seed 2 --format pgm") == 0
    tracked = "--tracking seen/resources.xml seen/experiment.xml --robots 1"
    link = f"--host 127.0.0.1 --port {port}"
    for trust in ("--key swarm.key", "--insecure"):
        words = f"{tracked} {link} {trust} -o {trust[2]}"
        assert vsense(f"robot check foraging {words} --wait 1") == 1
        until(f"robot calibrate foraging {words}1 --wait 60", "waiting: 0 of 1 robots")


@pytest.mark.quick
def test_files_take_all_options(folder: Path, said: Any) -> None:
    made = DATA / "made-by-0.1"
    recorded, table = made / "lab-run" / "mine.mcap", made / "campaign" / "results.csv"
    film = said(f"export {recorded} --video film.webp --from 0 --to 1 --robot 31 --json")
    assert film["frames"] > 1
    measure, base = "robots_on_spot", "mine.stop_probability=0.1"
    asked = f"--by condition --measure {measure} --same {measure}=1 --unpaired --seed 3"
    words = f"report {table} {asked} --against {base} --style ggplot --format svg -o report --json"
    assert [*said(words)["studies"][0]["measures"]] == [measure]
    named = "--name Mine --license MIT --date 2026-01-02 --pictures --against blind"
    assert vsense(f"pack {made}/mine/kept-sim {asked} {named} -o mine.zip --json") == 0
    assert vsense("reproduce mine.zip --check --json") == 0
    until(
        f"replay {recorded} --speed 2 --insecure {WATCHED}", "https://.*to-control-it", "Foxglove"
    )
    assert (
        vsense("camera markers --ids 1 --paper letter --family arrow4x4-thesis -o sheet.pdf") == 0
    )
    assert said("camera markers --roster swarm.toml -o robots.pdf --json")["tags"] == [*TAGS]
    assert vsense("new other --from phototaxis") == 0 and Path("other/other.argos").exists()
    assert vsense("camera calibrate example shown --board charuco:7x5:80mm:4X4_50 --seed 2") == 0


def test_pictures_are_tracked_served_and_aligned_with_all_options(folder: Path) -> None:
    assert vsense("camera render foraging seen --frames 3 --seed 2 --format pgm") == 0
    files, port = "seen/resources.xml seen/experiment.xml", free_ports(1)[0]
    words = f"camera track {files} --hold --record --roster swarm.toml --insecure -o tracked"
    until(f"{words} {WATCHED}", "https://.*to-control-it", "Foxglove: ws://")
    until(f"camera serve {files} --port {port} --roster swarm.toml", f"port {port}")
    until(
        "camera arena align foraging --cameras seen/cameras --pictures seen/pictures"
        f" --camera cam_0_0 --port {port}", f":{port}",
    )  # fmt: skip
    Path("points.csv").write_text("id,x_m,y_m\nnail,0.5,0.4\nscrew,-0.5,0.4\n")
    clicks = "--click cam_0_0:nail:800,600 --click cam_0_0:screw:200,600"
    words = f"camera arena align foraging --cameras seen/cameras --points points.csv {clicks}"
    assert vsense(f"{words} --height 12cm --dry") in (0, 1)
    for command in ("series plan.toml --mode run", "benchmark --quick --mode run"):
        words = f"{command} --roster swarm.toml --tracking {files} --insecure --no-deploy"
        until(f"{words} --host 127.0.0.1 --port {port} -o {command[:3]}", "connected|port")


def test_benchmarks_take_all_their_options(folder: Path) -> None:
    port, lines = free_ports(2)
    lab = f"--roster swarm.toml --replace 31=99 {SWARM} {ERRORS} --cameras 2x2 --pace 0.9"
    words = f"benchmark --quick --mode lab {lab} --port {port} -o lab {WATCHED}"
    until(words, "https://.*to-control-it", "Foxglove: ws://")
    link = f"--host 127.0.0.1 --port {port} --tracker lines:{lines} --virtual-devices"
    real = f"--roster swarm.toml {link} --target host --no-deploy --sudo --ssh-option Port=9"
    words = f"benchmark --quick --mode run -o run {real} --key swarm.key --other-programs"
    words += " --link-check 2"
    until(words, "port|connected")
    assert vsense("benchmark --quick --dry -j 2 --allow-upgrade") == 0
