"""Experiments from Python: what the page says runs, and is what the command does."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vsense
from tests.conftest import require_tool
from tests.monitor.ui.browser import Browser, Page
from tests.rigs.places import DATA, ROOT
from vsense import cli
from vsense.base.errors import UsageError
from vsense.studies.notebook import load_experiment
from vsense.studies.results import FinishedRun, RunTable


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


PAGE = (ROOT / "vsense" / "studies" / "PYTHON.md").read_text()
BLOCKS = re.findall(r"(?<!`:\n\n)```python\n(.*?)```", PAGE, re.S)
FILES = dict(re.findall(r"`(\w+\.py)`:\n\n```python\n(.*?)```", PAGE, re.S))
SHIPPED = ROOT / "vsense" / "config" / "experiments"


def teach(**how: int) -> Any:
    """What learn.py of the page has learnt, and the file's functions."""
    names: dict[str, Any] = {}
    exec(FILES["learn.py"], names)
    return names["learn"](**how), names


def learnt_experiment(folder: Path) -> Path:
    """The copy of the shipped one as the page describes it, for learnt.onnx in the same folder."""
    assert cli.main(["new", "--from", "phototaxis", str(folder / "learnt")]) == 0
    path = folder / "learnt" / "learnt.argos"
    text = path.read_text().replace('library="learnt.c"', 'library="learnt.onnx"')
    assert "learnt.onnx" in text
    path.write_text(re.sub(r"<params .*/>", "", text))
    (folder / "learnt.onnx").rename(path.with_name("learnt.onnx"))
    return path


def test_the_page_teaches_a_swarm_which_then_drives(folder: Path) -> None:
    weights, names = teach(generations=2, pairs=2)
    assert weights.shape == (34,) and names["distance_m"](weights, 1) > 0.0
    matrix, bias = names["layer"](weights)
    vsense.save_policy("learnt.onnx", [(matrix, bias, "tanh")])
    check_drives(learnt_experiment(folder), lambda seen: np.tanh(seen @ matrix + bias))


def check_drives(path: Path, act: Callable[[Any], Any]) -> None:
    """Asserts that robots of an experiment move as arrays of observations (n, 16) tell them to."""
    experiment = load_experiment(path, robots=5, duration_s=5)
    run = experiment.simulate(1, "out")
    with vsense.SteppedSimulation(load_experiment("phototaxis", robots=5).experiment, 1) as sim:
        light, ring = sim.swarm.sensor("light"), sim.swarm.sensor("proximity")
        for poses in run.poses:
            # A wheel that is a step per second faster for 5 s is 0.6 mm ahead.
            assert np.abs(sim.poses[:, :2] - poses[:, :2]).max() < 0.001
            seen = np.hstack((light.values, ring.values))
            sim.swarm.set_wheels(*(1000 * act(seen)).T)
            sim.step()
    assert np.ptp(run.poses[:, :, :2], axis=0).max() > 0.02


@pytest.mark.campaign
def test_a_swarm_learns_to_go_to_the_light_and_does_in_the_lab(folder: Path) -> None:
    weights, names = teach()
    with_light, blind = (
        np.mean([names["distance_m"](weights, seed, blind) for seed in range(1, 6)])
        for blind in (False, True)
    )
    assert with_light < 0.2 < 0.8 < blind
    vsense.save_policy("learnt.onnx", [(*names["layer"](weights), "tanh")])
    words = ["--robots", "5", "--duration", "30", "--port", "0", "-o", "out"]
    assert cli.main(["lab", str(learnt_experiment(folder)), *words]) == 0
    distances = FinishedRun(Path("out")).measured["light_distance_m"]
    assert np.mean(distances[len(distances) // 3 :]) < 0.3


@pytest.mark.campaign
def test_what_the_page_exports_from_pytorch_drives(folder: Path) -> None:
    torch = pytest.importorskip("torch")
    pytest.importorskip("onnxscript")
    page = (ROOT / "vsense" / "EXTENDING.md").read_text()
    names: dict[str, Any] = {}
    exec(re.findall(r"`export.py`:\n\n```python\n(.*?)```", page, re.S)[0], names)
    (folder / "walk.onnx").rename("learnt.onnx")
    torch.manual_seed(1)
    net = names["Walk"]().eval()

    def act(seen: Any) -> Any:
        return net(torch.tensor(seen, dtype=torch.float32)).detach().numpy()

    check_drives(learnt_experiment(folder), act)


@pytest.mark.campaign
def test_what_stable_baselines_learns_drives(folder: Path) -> None:
    for package in ("stable_baselines3", "supersuit", "onnxscript"):
        pytest.importorskip(package)
    names: dict[str, Any] = {}
    exec(FILES["ppo.py"], names)
    names["learn"]()
    experiment = load_experiment(learnt_experiment(folder), robots=5, duration_s=30)
    runs = [experiment.simulate(seed, f"out-{seed}") for seed in range(1, 6)]
    distances = np.array([run.measured["light_distance_m"] for run in runs])
    assert distances[:, 0].mean() > 1.0 and distances[:, -1].mean() < 0.7


LAB = 4
"""The block that is in real time."""


@pytest.mark.parametrize(
    "number", [pytest.param(n, marks=[pytest.mark.paced] * (n == LAB)) for n in range(len(BLOCKS))]
)
def test_the_page_runs_as_it_is(number: int, capsys: pytest.CaptureFixture[str]) -> None:
    exec(compile(BLOCKS[number], "page", "exec"), {})
    out, err = capsys.readouterr()
    assert out.count("\n") == (4, 2, 3, 1, 2, 1, 1, 4)[number] and err == ""
    # What stands behind a line as a comment is what it printed.
    said = re.findall(r"print\(.*\)\s*# ([({\[][^:]*[)}\]](?=$|:)|{.*})", BLOCKS[number], re.M)
    assert len(said) == (3, 0, 0, 0, 0, 0, 0, 0)[number]
    assert all(text in out for text in said)


def test_a_run_is_that_of_the_command() -> None:
    run = vsense.load("foraging", {"foraging.pull": 0.2}, robots=5, duration_s=20).simulate(3, "a")
    words = ["sim", "foraging", "--set", "foraging.pull=0.2", "--robots", "5", "--seed", "3"]
    assert cli.main([*words, "--duration", "20", "--output", "b"]) == 0
    theirs = FinishedRun(Path("b"))
    assert run.folder == Path("a").resolve() and run.valid
    for ours, other in ((run.poses, theirs.poses), (run.leds, theirs.leds)):
        assert ours.shape[:2] == (200, 5) and np.array_equal(ours, other)
    summary = json.loads(Path("b/summary.json").read_text())
    assert run.measures == summary["measures"]
    assert {k: v for k, v in run.summary.items() if k != "speedup"} == {
        k: v for k, v in summary.items() if k != "speedup"
    }
    columns = run.columns()
    at = (columns["tag"] == run.tags[2]) & (columns["time_s"] == run.time_s[7])
    assert columns["x_m"][at] == run.poses[7, 2, 0] and len(columns["x_m"]) == 1000
    assert [text for _, text in run.events] == [text for _, text in theirs.events]
    assert run.measured["items_home"].shape == (200,)
    assert run.measured["items_home"][-1] == run.measures["items_home"]
    assert "items home" in run._repr_html_() and "image/png;base64,iVBOR" in run._repr_html_()


@pytest.fixture
def page() -> Iterator[Page]:
    """A page in a browser of its own."""
    browser = Browser(require_tool("chromium", "chromium"))
    yield browser.open("about:blank", 700, 700)
    browser.close()


def test_a_run_is_drawn_into_axes() -> None:
    run = vsense.load("foraging", robots=3, duration_s=4).simulate(1, "a")
    from matplotlib.figure import Figure  # takes a second, which nobody else waits for

    axes = Figure().subplots()
    run.draw(axes, until_s=2, color="red")
    assert axes.images[0].get_extent() == pytest.approx([-1.5, 1.5, -1.2, 1.2])
    assert axes.images[0].get_array().shape[:2] == (1024, 1280)
    ways, ends = axes.lines[::2], axes.lines[1::2]
    for robot, (way, end) in enumerate(zip(ways, ends, strict=True)):
        shown = run.poses[run.time_s <= 2, robot, :2]
        assert np.array_equal(way.get_xydata(), shown) and len(shown) == 21
        assert np.array_equal(end.get_xydata(), shown[-1:]) and end.get_color() == "red"
    with pytest.raises(UsageError, match="FinishedRun\\(folder, experiment\\)"):
        vsense.FinishedRun(Path("a")).draw(axes)


def test_a_run_plays_in_a_notebook(page: Page) -> None:
    run = vsense.load("foraging", robots=5, duration_s=20).simulate(1, "a")
    player = run.play()
    model = {
        name: list(value) if isinstance(value, bytes) else value
        for name, value in player.get_state().items()
        if name in ("poses", "leds", "picture", "robots", "timestep_s", "arena", "radii_m")
    }
    script = json.dumps((ROOT / "vsense" / "studies" / "player.js").read_text())
    page.value(
        f"(async () => {{ const given = {json.dumps(model)};"
        " const get = (name) => Array.isArray(given[name]) && !['arena', 'radii_m'].includes(name)"
        " ? new DataView(new Uint8Array(given[name]).buffer) : given[name];"
        f" const script = URL.createObjectURL(new Blob([{script}], {{type: 'text/javascript'}}));"
        " window.player = (await import(script)).default;"
        " window.end = player.render({model: {get}, el: document.body}); })()"
    )
    page.until("document.querySelector('span').textContent === '0.0 s'")
    canvas = "document.querySelector('canvas')"
    at = f"Array.from({canvas}.getContext('2d').getImageData({{}}, {{}}, 1, 1).data)"
    width_px = page.value(f"{canvas}.width")

    def colour(step: int, robot: int) -> list[int]:
        x_m, y_m, yaw = run.poses[step, robot]
        left_m, low_m, width_m, depth_m = player.arena
        zoom, behind_m = width_px / width_m, 0.5 * player.radii_m[robot]
        x_m, y_m = x_m - behind_m * np.cos(yaw), y_m - behind_m * np.sin(yaw)
        place = round((x_m - left_m) * zoom), round((low_m + depth_m - y_m) * zoom)
        return list(page.value(at.format(*place)))

    blue = [0x2F, 0x6F, 0xB7, 255]
    assert all(colour(0, robot) == blue for robot in range(5))
    page.value(
        "(() => { const s = document.querySelector('input'); s.value = 150;"
        " s.dispatchEvent(new Event('input')); })()"
    )
    assert page.text("span") == "15.0 s" and all(colour(150, r) == blue for r in range(5))
    assert colour(0, 0) != blue or np.allclose(run.poses[0, 0], run.poses[150, 0], atol=0.05)
    page.click("button")
    page.until("document.querySelector('span').textContent === '19.9 s'")
    assert page.text("button") == "Play", "it has come to its end"


def test_a_run_that_cannot_play_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    vsense.load("foraging", robots=2, duration_s=1).simulate(1, "a")
    with pytest.raises(UsageError, match="a: expected a run that simulate"):
        FinishedRun(Path("a")).play()
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(UsageError, match=r"play\(\) needs the Python package anywidget"):
        FinishedRun(Path("a")).play()


def test_changing_makes_another_one() -> None:
    first = load_experiment("foraging", duration_s=10)
    more = first.changed({"foraging.pull": 0.2}, robots=3).changed({"foraging.trail": 1})
    assert (len(first.experiment.robots), len(more.experiment.robots)) == (15, 3)
    params = more.experiment.controllers[0].params
    assert (params["pull"], params["trail"], more.experiment.length_s) == ("0.2", "1", 10.0)
    assert first.experiment.controllers[0].params["pull"] == "0.05"
    assert "foraging" in str(first) and first.experiment.name == "foraging"


def test_a_campaign_is_a_table_that_goes_on(capsys: pytest.CaptureFixture[str]) -> None:
    experiment = load_experiment("foraging", {"foraging.trail": 2}, robots=4, duration_s=5)
    runs = experiment.simulate_many([1, 2], {"foraging.release": [0, 1]}, "release.csv")
    before = Path("release.csv").read_bytes()
    columns = runs.columns()
    assert columns["foraging.release"].tolist() == [0, 0, 1, 1]
    assert columns["seed"].tolist() == [1, 2, 1, 2] and columns["items_home"].dtype == float
    more = [1, 2, 3], {"foraging.release": [0, 1]}, "release.csv"
    with ThreadPoolExecutor(1) as pool:  # as widgets and servers call it
        again = pool.submit(experiment.simulate_many, *more).result()
    assert Path("release.csv").read_bytes() != before and len(again.rows) == 6
    assert "<td>1.0</td>" in again._repr_html_()
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("act", "words"),
    [
        (lambda: load_experiment("forageing"), "is 'foraging' meant"),
        (lambda: load_experiment("foraging", {"foraging.relese": 1}), "is 'release' meant"),
        (lambda: load_experiment("foraging", {"foraging.release": -1}), "number of 0 or more"),
        (lambda: RunTable(Path("none.csv")).rows, "none.csv"),
        (lambda: load_experiment("foraging", robots=0), "robots=0: expected a whole number, 1 or"),
        (lambda: load_experiment("foraging", robots=2.5), "robots=2.5: expected a whole number"),
        (lambda: load_experiment("foraging", duration_s=float("nan")), "expected a number, 0 or"),
        (lambda: load_experiment("foraging").simulate(2**32), "0 to 4294967295"),
        (lambda: load_experiment("foraging").simulate("a"), "seed='a': expected a whole"),
        (lambda: load_experiment("foraging").simulate_many([1, 1]), "one or more, each once"),
        (lambda: load_experiment("foraging").simulate_many([1], on=7), "on=7: expected HOST:PORT"),
        (lambda: load_experiment("foraging").simulate_many([]), "one or more, each once"),
        (lambda: load_experiment("foraging").simulate_many(3), "expected a list"),
        (lambda: load_experiment("foraging").simulate_many([1], jobs=-1), "jobs=-1: expected"),
        (lambda: load_experiment("foraging").simulate_many([1], {"a.b": []}), "a.b=.*a list"),
        (lambda: FinishedRun(Path("nowhere")).measures, "is left by no run"),
    ],
)
def test_what_is_wrong_is_one_sentence(act, words: str) -> None:
    with pytest.raises(vsense.VsenseError, match=words):
        act()


@pytest.mark.parametrize(
    ("name", "data", "read"),
    [
        ("trajectory.npz", b"PK", lambda run: run.poses),
        ("trajectory.npz", b"\x93NUMPY\x01\x00v\x00{'descr': '|O'", lambda run: run.leds),
        ("summary.json", b"{", lambda run: run.summary),
        ("summary.json", b"[1]", lambda run: run.measures),
        ("measures.csv", b"time_s,a\n1,x\n", lambda run: run.measured),
        ("events.csv", b"time_s,text\n1," + b"x" * 200_000, lambda run: run.events),
        ("events.csv", b"time_s,text\n1,\xff\n", lambda run: run.events),
    ],
)
def test_a_damaged_file_of_a_run_is_one_sentence(
    name: str, data: bytes, read: Any, tmp_path: Path
) -> None:
    (tmp_path / name).write_bytes(data)
    with pytest.raises(
        vsense.VsenseError, match=rf"{name}: (cannot be read|is left by no run): \w+"
    ):
        read(FinishedRun(tmp_path))


def test_loading_needs_no_opencv() -> None:
    code = "import sys, vsense; vsense.load('foraging'); print('cv2' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"


def test_data_frames() -> None:
    import pandas  # takes a second, which nobody else waits for

    run = load_experiment("foraging", robots=3, duration_s=2).simulate(1, "a")
    frame = run.to_pandas()
    assert (
        isinstance(frame, pandas.DataFrame)
        and frame.groupby("tag")["x_m"].size().tolist() == [20] * 3
    )


def test_pandas_that_is_missing_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    run = load_experiment("foraging", robots=3, duration_s=2).simulate(1, "a")
    with pytest.raises(UsageError, match=r"to_pandas\(\) needs the Python package pandas: .*pip"):
        run.to_pandas()


def test_a_packages_tables_are_read_and_a_damaged_one_is_refused(folder: Path) -> None:
    kept = (DATA / "made-by-0.1" / "kept.zip").read_bytes()
    Path("kept.zip").write_bytes(kept)
    (table,) = vsense.unpack("kept.zip", "kept")
    columns = table.columns()
    assert table.path == Path("kept/kept-sim/runs.csv") and len(columns["run"]) == 2
    with vsense.open_recording("kept/kept-sim/run-001/mine.mcap") as recording:
        assert recording.experiment
    with pytest.raises(vsense.VsenseError, match="kept: is not empty"):
        vsense.unpack("kept.zip", "kept")
    Path("cut.zip").write_bytes(kept[:-100])
    with pytest.raises(vsense.VsenseError, match=r"cut\.zip: is no package"):
        vsense.unpack("cut.zip", "cut")


def test_a_name_whose_package_is_missing_says_how_to_install_it() -> None:
    code = "import sys; sys.modules['zstandard'] = None; from vsense import open_recording"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    words = "ModuleNotFoundError: vsense.open_recording needs the Python package zstandard: "
    assert words in done.stderr and "install" in done.stderr.splitlines()[-1]
