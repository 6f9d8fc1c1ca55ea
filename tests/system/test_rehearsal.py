"""`vsense run` rehearsed: emulated robots and their tracker in one process, the run in another."""

from __future__ import annotations

import json
import re
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.rigs.processes import free_port
from tests.system.rehearsal import TAGS, VSENSE, Curtain, emulated
from vsense.config.experiment import SHIPPED_FOLDER
from vsense.modes.lab._microcontrollers import read_actuations
from vsense.monitor.recording.reader import open_recording
from vsense.robots import build
from vsense.run.runs_csv import RUNS, read_runs

pytestmark = pytest.mark.system


def test_a_run_is_rehearsed_with_emulated_robots(tmp_path: Path) -> None:
    with emulated(tmp_path) as stage:
        measured = stage.link(1.5)
        stood = read_actuations(tmp_path / "robots" / "actuations.bin")
        words = ("--duration", "3", "--json", "--home", "-o", str(tmp_path / "run"))
        done = stage.run(*words, "--link-check", "2")
    check_links(measured, stood)
    assert done.returncode == 0, done.stderr
    assert "2 of 2 robots stand at their starts after" in done.stderr
    summary = json.loads(done.stdout)
    assert summary["arena"]["seen_mean"] == 2.0
    assert [robot["connected_share"] for robot in summary["per_robot"]] == [1.0, 1.0]
    check_the_check(summary, done.stderr, tmp_path / "run" / RUNS)
    text = stage.said.read_text()
    command_told = re.search(r"in another terminal: (vsense run .*)", text)
    assert command_told is not None
    ports = f"--tracker lines:{stage.lines} --port {stage.port}"
    assert command_told[1] == f"vsense run foraging {ports} --robots 2 --insecure"
    assert (tmp_path / "robots" / "actuations.bin").stat().st_size > 0, "wheels were moved"
    scripts = sorted((tmp_path / "robots" / "robots").glob("*.sh"))
    tags = [script.stem for script in scripts]
    alive = subprocess.run(["pgrep", "-f", str(tmp_path)], capture_output=True, text=True).stdout
    assert len(tags) == 2 and alive == "", "no daemon is left"


def check_the_check(summary: dict[str, Any], said: str, table: Path) -> None:
    """Both links are weak, as `emulated` has it, and hold: the run is valid, with a note."""
    weak, asleep = TAGS
    assert [robot["tag"] for robot in summary["link_check"]] == list(TAGS)
    assert all(robot["packets"] > 20 for robot in summary["link_check"])
    assert f"robot {weak} before the run: holds 100 ms, -84 dBm is weak" in summary["note"]
    assert f"robot {asleep} before the run: holds 100 ms, power saving is on" in summary["note"]
    assert said.index("links over 2 s:") < said.index("driving home")
    (row,) = read_runs(table)
    assert row.valid and (row.signal_dbm, row.power_saving) == (-84, (asleep,))
    assert row.longest_silence_s is not None and 0.0 < row.longest_silence_s < 1.0


def test_a_robot_that_is_not_seen_stands_alone_and_goes_on(tmp_path: Path) -> None:
    other, hidden = TAGS
    with emulated(tmp_path) as stage:
        port = free_port()
        curtain = Curtain(
            stage.lines, port, lambda _, time_s: {hidden} if 5.0 <= time_s < 8.0 else set()
        )
        words = ("--duration", "10", "--json", "-o", str(tmp_path / "run"))
        done = stage.run(*words, lines=port)
    assert done.returncode == 0, done.stderr
    assert re.search(r"robot \S+ stands: not seen for 1\.\d s", done.stderr), done.stderr
    assert "is seen again and goes on; it stood 2." in done.stderr
    stood = {r["tag"]: r["stood_unseen_s"] for r in json.loads(done.stdout)["per_robot"]}
    assert stood[other] == 0.0 and 1.9 <= stood[hidden] <= 2.9
    rows = read_actuations(tmp_path / "robots" / "actuations.bin")
    begin_ns, end_ns = curtain.hidden_ns
    turns = (rows["left_steps_s"] != 0) | (rows["right_steps_s"] != 0)
    late = (rows["time_ns"] > begin_ns + 1_600_000_000) & (rows["time_ns"] < end_ns)
    # A row is a change of speed: who went straight on has none meanwhile.
    others = rows["robot"] == TAGS.index(other)
    newest = np.flatnonzero(others & (rows["time_ns"] < end_ns))[-1]
    assert turns[newest] or turns[late & others].any(), "the other one goes on"
    assert not turns[late & (rows["robot"] == TAGS.index(hidden))].any()
    assert turns[(rows["time_ns"] > end_ns) & (rows["robot"] == TAGS.index(hidden))].any()


def older_second(folder: Path) -> Path:
    """Foraging as somebody has deployed it: the second robot has an older source."""
    text = (SHIPPED_FOLDER / "foraging.argos").read_text()
    controller = re.search(r"<foraging_controller.*?</foraging_controller>", text, re.S)
    placed = re.search(r"<distribute>.*?</distribute>", text, re.S)
    assert controller is not None and placed is not None
    older = controller[0].replace('id="ant" library="foraging"', 'id="old" library="./older.c"')
    tags = re.compile(r'quantity="15"(.*?)vs:tags="[^"]*"', re.S)
    first, second = (
        tags.sub(rf'quantity="1"\1vs:tags="{tag}"', placed[0]).replace('"ant"', f'"{whose}"')
        for tag, whose in zip(TAGS, ("ant", "old"))
    )
    second = second.replace('id="epuck"', 'id="second"')
    text = text.replace(controller[0], controller[0] + older).replace(placed[0], first + second)
    source = build.source_tree().controllers()["foraging"].read_text()
    (folder / "older.c").write_text(f"/* older */\n{source}")
    (folder / "foraging.py").write_bytes((SHIPPED_FOLDER / "foraging.py").read_bytes())
    path = folder / "older.argos"
    path.write_text(text)
    return path


def test_a_robot_with_another_program_is_refused_and_the_run_is_invalid(tmp_path: Path) -> None:
    words = ("--duration", "2", "--json", "-o")
    with emulated(tmp_path, experiment=str(older_second(tmp_path))) as others:
        stage = replace(others, experiment="foraging")
        refused = stage.run(*words, str(tmp_path / "refused"), "--start-after", "3", "--record")
        taken = stage.run(*words, str(tmp_path / "taken"), "--other-programs")
    runs = r"runs 'foraging' \(\w{12}\), the file says 'foraging' \(\w{12}\)"
    assert refused.returncode == 1, refused.stderr
    summary = json.loads(refused.stdout)
    assert summary["verdict"] == "void"
    assert re.match(rf"robot 1843 was refused: it {runs}: bring", summary["why"])
    assert f"verdict   INVALID: {summary['why']}" in refused.stderr
    assert summary["per_robot"][0]["connected_share"] == 1.0, "it went on for the other"
    (row,) = read_runs(tmp_path / "refused" / RUNS)
    assert (row.verdict, row.why, row.note) == ("void", summary["why"], "")
    assert f"this run is invalid: {summary['why']}" in refused.stderr
    with open_recording(tmp_path / "refused" / "foraging.mcap") as recording:
        assert (recording.run.verdict, recording.run.why) == ("void", summary["why"])
        assert recording.lacks()[0].endswith(f"its run is invalid: {summary['why']}")
    assert taken.returncode == 0, taken.stderr
    summary = json.loads(taken.stdout)
    assert (summary["verdict"], summary["why"]) == ("valid", "")
    assert re.fullmatch(rf"robot 1843 {runs}", summary["note"])


def check_links(measured: subprocess.CompletedProcess[str], stood: NDArray[np.void]) -> None:
    """The real daemons tell of the radios that they were given, and made steps without a move."""
    told = json.loads(measured.stdout)
    # How fast this machine is, is not the question.
    assert measured.returncode == int(not told["holds"]), measured.stderr
    weak, asleep = told["robots"]
    assert (weak["signal_dbm"], weak["bit_rate_mbit_s"], weak["power_saving"]) == (-84, 5.5, False)
    assert "-84 dBm is weak" in weak["advice"]
    assert (asleep["weakest_dbm"], asleep["retries"], asleep["power_saving"]) == (-61, 0, True)
    assert asleep["advice"] == "power saving is on: vsense robot deploy turns it off"
    for one in (weak, asleep):
        assert one["packets"] > 10 and one["round_trip_p50_ms"] > 0.0
        assert one["late"] is not None, "control steps were made"
    assert not stood["left_steps_s"].any() and not stood["right_steps_s"].any()


def test_robots_and_tracker_need_two_ports(tmp_path: Path) -> None:
    command = [*VSENSE, "robot", "emulate", "2", "--insecure", "-o", str(tmp_path / "robots")]
    ports = ["--port", "4060", "--tracker-port", "4060"]
    done = subprocess.run([*command, *ports], capture_output=True, text=True, timeout=60)
    assert done.returncode == 2
    assert done.stderr.startswith("vsense: 4060 is both the port for robots and that for the")
    assert not (tmp_path / "robots").exists()
