"""The whole command with a real GigE Vision camera on loopback: Aravis' own simulator."""

from __future__ import annotations

import json
import os
import pty
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import cv2
import pytest

from tests.conftest import require_library, require_tool
from tests.rigs.places import ROOT
from tests.rigs.web import page_options
from vsense.config import resources
from vsense.vision.cameras.camera import Camera

pytestmark = pytest.mark.system

SERIAL = f"V{os.getpid()}"
ID = f"Aravis-Fake-{SERIAL}"
ADDRESS = "127.0.0.1"
PATIENCE_S = 60.0
SPACE = f"vscam{os.getpid() % 100_000}"
IP = shutil.which("ip")
ALONE: list[str] = []
"""What programs begin with that have a loopback of their own."""
PROGRAM = [sys.executable, "-m", "vsense", "cameras"]


@pytest.fixture(scope="module", autouse=True)
def loopback() -> Iterator[None]:
    """Makes a loopback of our own, where that is allowed: on the host's there may be others."""
    if (
        IP is not None
        and subprocess.run([IP, "netns", "add", SPACE], capture_output=True).returncode == 0
    ):
        subprocess.run([IP, "-n", SPACE, "link", "set", "lo", "up"], check=True)
        ALONE.extend((IP, "netns", "exec", SPACE))
    yield
    if IP is not None and ALONE:
        ALONE.clear()
        subprocess.run([IP, "netns", "del", SPACE], check=True)


class Simulator:
    """The camera: it can be switched off and on."""

    def __init__(self) -> None:
        self._program = require_tool("arv-fake-gv-camera-0.8", "aravis-tools")
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        """Switches it on, and waits until it answers."""
        words = [*ALONE, self._program, "-i", ADDRESS, "-s", SERIAL]
        self._process = subprocess.Popen(words, stderr=subprocess.DEVNULL)
        load = "from vsense.vision.cameras._networks import answers"
        ask = f"{load}; raise SystemExit(not answers('{ADDRESS}'))"
        for _ in range(20):
            if subprocess.run([*ALONE, sys.executable, "-c", ask], cwd=ROOT).returncode == 0:
                return
        self.kill()
        raise AssertionError("the simulator does not answer: does another hold this address?")

    def silence(self) -> None:
        """Has it answer nothing any more; it can only be killed then."""
        assert self._process is not None
        self._process.send_signal(signal.SIGSTOP)

    def kill(self) -> None:
        """Switches it off."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()


@pytest.fixture
def camera(loopback: None) -> Iterator[Simulator]:
    """A camera that answers."""
    require_library("libaravis-0.8.so.0", "libaravis-0.8-0")
    simulator = Simulator()
    simulator.start()
    yield simulator
    simulator.kill()


def run(*words: str, code: int = 0, **how: object) -> subprocess.CompletedProcess[str]:
    """Runs an action; nothing it says is ever a traceback."""
    done = subprocess.run(
        [*ALONE, *PROGRAM, *words], capture_output=True, text=True, timeout=PATIENCE_S, cwd=ROOT,
        **{"stdin": subprocess.DEVNULL, **how} if "input" not in how else how,
    )  # fmt: skip
    assert done.returncode == code, (words, done.stdout, done.stderr)
    assert "Traceback" not in done.stderr
    return done


def mine() -> dict[str, object]:
    """What the list says of the camera."""
    (row,) = [row for row in json.loads(run("list", "--json").stdout) if row["id"] == ID]
    return row


def test_from_the_list_to_a_file_that_loads(camera: Simulator, tmp_path: Path) -> None:
    row = mine()
    assert (row["kind"], row["address"], row["serial"]) == ("GigE", ADDRESS, SERIAL)
    assert (row["width_px"], row["height_px"], row["rate_hz"]) == (512, 512, 25.0)
    assert row["exposure_bounds_us"] == [10.0, 1e7] and row["trouble"] is None
    lines = run().stdout.splitlines()
    assert lines[0].split() == ["id", "kind", "address", "model", "resolution", "rate", "formats"]
    assert any(line.startswith(ID) and "512x512" in line for line in lines)

    run("init", str(tmp_path))
    read = resources.load(tmp_path / "resources.xml")
    (own,) = [id for id, spec in read.grabbers.items() if spec.source == ADDRESS]
    path = str(tmp_path / "resources.xml")
    told = json.loads(run("tune", own, "--resources", path, "--json").stdout)
    assert (told["width_px"], told["exposure_us"], told["tags"]) == (512, 10_000.0, [])
    wanted = ("--rate", "20", "--width", "320", "--height", "200", "--family", "aruco_4x4_50")
    scales = (("--focal-px", "600", "--height-m", "2"), ("--px-per-m", "300"))
    for scale in scales:
        words = (*wanted, *scale, "--speed", "0.2")
        told = json.loads(run("tune", own, "--resources", path, *words, "--json").stdout)
        assert (told["width_px"], told["px_per_m"], told["speed_m_s"]) == (320, 300.0, 0.2)
    (row,) = json.loads(run("--json").stdout)
    assert row["id"] == ID
    run("init", str(tmp_path), code=2)
    run("init", str(tmp_path), "--force")
    refused = run("tune", "nix", "--resources", path, code=2).stderr
    assert refused.startswith("vsense: no camera 'nix' among the grabbers of") and own in refused


def test_one_picture_into_a_file(camera: Simulator, tmp_path: Path) -> None:
    for name, by in (("a.png", SERIAL), ("a.jpg", ADDRESS)):
        path = tmp_path / name
        size = ("--width", "320", "--height", "200")
        size = (*size, "--exposure", "9000", "--rate", "20", "--family", "aruco_4x4_50")
        done = run("show", by, "--save", str(path), *size, "--gain", "99")
        assert done.stdout == f"{path}\n"
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        assert image is not None and image.shape == (200, 320)
        assert 100 < image.mean() < 160, "a ramp"
        assert "does not take gain_raw 99 (0 to 10): keeps 0" in done.stderr
    assert run("show", ID, "--save", "a.gif", code=2).stderr.count("\n") == 1
    unwritable = run("show", ID, "--save", str(tmp_path / "no/a.png"), code=1).stderr
    assert "cannot be written" in unwritable
    unknown = run("show", "nix", "--save", str(path), code=2).stderr
    assert unknown.startswith("vsense: no camera 'nix': there") and ID in unknown


_ATTACKED = f"""
import random, socket, sys, threading
from vsense.vision.cameras._aravis_camera import AravisCamera, AravisStream
from vsense.vision.cameras.picture import PictureError

def ports():
    lines = open("/proc/self/net/udp").read().splitlines()[1:]
    return {{int(line.split()[1].partition(":")[2], 16) for line in lines}}

before = ports()
stream = AravisStream(AravisCamera("{ADDRESS}"))
mine = sorted(ports() - before)
sent, over, chance = 0, threading.Event(), random.Random(1)

def attack():
    global sent
    stranger = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    stranger.bind(("127.0.0.2", 0))
    while not over.is_set():
        rubbish = chance.randbytes(chance.choice((0, 1, 7, 8, 44, 1400)))
        stranger.sendto(rubbish, ("{ADDRESS}", mine[sent % len(mine)]))
        sent += 1

thread = threading.Thread(target=attack, daemon=True)
thread.start()
images, calm = [], 0
while calm < 20:
    if sent > 5000:
        over.set()
        thread.join()
        calm += 1
    try:
        images.append(stream.read(5.0))
    except PictureError:
        calm = 0  # what had come before is read first
stream.close()
print({{(image[0].shape, int(image[0].std())) for image in images}}, len(images) >= 20)
"""
"""Takes pictures of the camera while a stranger sends rubbish to the ports of its stream."""


def test_what_strangers_send_to_a_cameras_ports_is_no_picture(camera: Simulator) -> None:
    words = [*ALONE, sys.executable, "-c", _ATTACKED]
    done = subprocess.run(words, capture_output=True, text=True, cwd=ROOT, timeout=PATIENCE_S)
    assert done.returncode == 0, done.stderr
    assert done.stdout == "{((512, 512), 73)} True\n", "damaged at most, and told"


def test_a_sweep_leaves_the_camera_as_it_was(camera: Simulator) -> None:
    done = run("tune", ID, "--sweep", "--json", "--gain", "2", "--exposure", "3000")
    told = json.loads(done.stdout)
    means = {(row["exposure_us"], row["gain"]): row["mean"] for row in told["rows"]}
    assert means[2000.0, 0.0] < means[5000.0, 0.0] < means[10_000.0, 0.0]
    assert told["best"]["saturated"] <= 0.01
    assert "own values again: exposure_time_abs 3000, gain_raw 2" in done.stderr
    row = mine()
    assert (row["exposure_us"], row["gain"]) == (3000.0, 2.0)


def test_ctrl_c_in_a_sweep_leaves_the_camera_as_it_was(camera: Simulator) -> None:
    command, terminal = on_terminal("tune", ID, "--sweep")
    read_until(terminal, rb"(?s)markers.*us.*us")
    command.send_signal(signal.SIGINT)
    rest = read_until(terminal, rb"own values again[^\n]*\n")
    assert command.wait(PATIENCE_S) == 130 and b"Traceback" not in rest
    row = mine()
    assert (row["exposure_us"], row["gain"]) == (10_000.0, 0.0)


def test_a_camera_that_falls_silent_in_a_sweep_is_not_said_to_be_as_it_was(
    camera: Simulator,
) -> None:
    command, terminal = on_terminal("tune", ID, "--sweep")
    try:
        read_until(terminal, rb"(?s)markers.*us.*us")
        camera.silence()
        rest = read_until(terminal, rb"not put back: exposure_time_abs: [^\n]*\n")
        assert command.wait(PATIENCE_S) == 1
        assert b"best" not in rest and b"own values again" not in rest
    finally:
        command.kill()


def on_terminal(*words: str) -> tuple[subprocess.Popen[bytes], int]:
    """Starts an action on a terminal of its own; gives that, too."""
    ours, theirs = pty.openpty()
    command = subprocess.Popen(
        [*ALONE, *PROGRAM, *words], stdin=theirs, stdout=theirs, stderr=theirs, cwd=ROOT
    )
    os.close(theirs)
    return command, ours


def read_until(terminal: int, pattern: bytes) -> bytes:
    """Reads what is drawn until it shows something."""
    drawn = b""
    while not re.search(pattern, drawn):
        try:
            drawn += os.read(terminal, 65536)
        except OSError:
            raise AssertionError(f"ended without {pattern!r}: {drawn!r}") from None
    return drawn


def test_unplugged_and_back_while_somebody_watches(camera: Simulator) -> None:
    command, terminal = on_terminal("tune", ID)
    try:
        read_until(terminal, rb"pictures/s.*\n(?s:.*)advice")
        camera.kill()
        read_until(terminal, rb"gone, trying again")
        camera.start()
        read_until(terminal, rb"pictures/s.*\n(?s:.*)advice")
        command.send_signal(signal.SIGINT)
        assert command.wait(PATIENCE_S) == 130
    finally:
        command.kill()


def test_live_in_the_page_until_ctrl_c(camera: Simulator) -> None:
    command = subprocess.Popen(
        [*ALONE, *PROGRAM, "show", ID, "--web", "0"], stderr=subprocess.PIPE, text=True, cwd=ROOT
    )
    try:
        assert command.stderr is not None
        told = [command.stderr.readline() for _ in range(3)]
        url = re.search(r"http://\S+", told[0])
        assert url is not None and "Ctrl-C ends" in told[1], told
        code = f"from urllib.request import urlopen; print(urlopen({url[0]!r}).read())"
        page = subprocess.run([*ALONE, sys.executable, "-c", code], capture_output=True, text=True)
        assert "vsense" in page.stdout
        assert ID in told[2] and "mean grey" in told[2]
        command.send_signal(signal.SIGINT)
        assert command.wait(PATIENCE_S) == 130
        assert "Traceback" not in command.stderr.read()
    finally:
        command.kill()


def test_a_camera_of_another_program_is_listed_and_does_not_open(
    camera: Simulator, tmp_path: Path
) -> None:
    words = [ID, *page_options(tmp_path).split(), "--insecure"]
    holder = subprocess.Popen(
        [*ALONE, *PROGRAM, "show", *words], stderr=subprocess.PIPE, text=True, cwd=ROOT
    )
    try:
        assert holder.stderr is not None
        while "mean grey" not in holder.stderr.readline():
            pass
        row = mine()
        assert "another program controls it" in str(row["trouble"])
        assert row["width_px"] is None and row["address"] == ADDRESS
        refused = run("show", ID, "--save", str(tmp_path / "a.png"), code=1).stderr
        assert "another program" in refused and refused.count("\n") == 1
        holder.send_signal(signal.SIGINT)
        assert holder.wait(PATIENCE_S) == 130
    finally:
        holder.kill()
        holder.wait()


def test_moments_with_all_cameras_of_a_file(camera: Simulator, tmp_path: Path) -> None:
    path = tmp_path / "resources.xml"
    path.write_text(
        f'<arena_tracking_system><grabbers><grabber id="cam1" type="genicam" device="{ADDRESS}"'
        ' frame_rate="10" trigger="software" /></grabbers><trackers /><cameras />'
        "</arena_tracking_system>"
    )
    above = Camera.looking_down("above", 0.0, 0.0, 2.0, 800.0, (512, 512))
    (tmp_path / "above.json").write_text(above.to_json())
    calibrated = '<cameras><camera id="above" calibration="above.json" /></cameras>'
    path.write_text(path.read_text().replace("<cameras />", calibrated))
    of = ("--resources", str(path), "--camera", "above", "--marker-height", "0.4")
    assert json.loads(run("tune", "cam1", *of, "--json").stdout)["px_per_m"] == 500.0
    seen = str(tmp_path / "seen.png")
    run("show", "cam1", "--resources", str(path), "--save", seen)
    folder = tmp_path / "shoot"
    words = ("shoot", str(path), "-o", str(folder), "--board", "charuco:7x5:80mm:4X4_50")
    done = run(*words, input="\ntilt\n")
    assert "floor_01: cam1 no board" in done.stderr and "vsense camera calibrate rig" in done.stderr
    done = run(*words, "--every", "0.2", "--count", "1", "--name", "board", "--json")
    assert json.loads(done.stdout) == {"board_01": {"cam1": 0}}
    taken = sorted(path.name for path in (folder / "cam1").iterdir())
    assert taken == ["board_01.png", "floor_01.png", "tilt_01.png"]


def test_nobody_reads_the_output(camera: Simulator) -> None:
    for words in (("list", "--json"), ("tune", ID)):
        command = subprocess.Popen(
            [*ALONE, *PROGRAM, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=ROOT
        )
        assert command.stdout is not None and command.stderr is not None
        command.stdout.close()
        assert command.stderr.read() == b""
        assert command.wait(PATIENCE_S) == 0
