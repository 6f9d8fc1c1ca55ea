"""Charts as files: formats, the user's own style, and what happens without Matplotlib."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.studies.report.runs import messages, write
from vsense import cli
from vsense.base.errors import UsageError, VsenseError
from vsense.studies.report import _plot, lacking
from vsense.studies.report.report import REPORT_PAGE, make_report

ANOTHER_PROCESS = """
import importlib, pkgutil, sys
import vsense
from vsense.cli import main

for found in pkgutil.walk_packages(vsense.__path__, "vsense."):
    if not found.name.endswith("__main__"):
        importlib.import_module(found.name)
assert not any(name.startswith("matplotlib") for name in sys.modules)
assert main(["report", sys.argv[1], "-o", sys.argv[2], "--format", sys.argv[3]]) == 0
assert "matplotlib.figure" in sys.modules and "matplotlib.pyplot" not in sys.modules
"""


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    return write(tmp_path / "run.mcap", messages())


@pytest.fixture
def short(tmp_path: Path) -> Path:
    """A recording of latencies alone: two charts."""
    kept = [m for m in messages() if m.topic in ("/experiment", "/event", "/readings")]
    return write(tmp_path / "short.mcap", kept)


@pytest.fixture
def sheet(tmp_path: Path) -> Path:
    """A style of few and coarse pixels."""
    path = tmp_path / "mine.mplstyle"
    path.write_text("figure.figsize: 5, 3\nsavefig.dpi: 40\n")
    return path


def size_px(png: bytes) -> tuple[int, int]:
    return int.from_bytes(png[16:20]), int.from_bytes(png[20:24])


def test_matplotlib_is_imported_to_draw_only(recording: Path, tmp_path: Path) -> None:
    """Another process, with other hashes, draws the same bytes; text in SVG is text."""
    folder = tmp_path / "other"
    arguments = [str(recording), str(folder), "svg"]
    environment = os.environ | {"PYTHONHASHSEED": "7"}
    command = [sys.executable, "-c", ANOTHER_PROCESS, *arguments]
    subprocess.run(command, check=True, env=environment, cwd=tmp_path)
    made = make_report([recording], tmp_path / "here", form="svg")
    for path in made.files:
        assert path.read_bytes() == (folder / path.name).read_bytes(), path.name
    text = {path.stem: path.read_text() for path in made.files[1:]}
    assert ">time since the run began [s]</text>" in text["measures"]
    assert ">x [m]</text>" in text["ways"] and ">time [s]</text>" in text["occupancy"]
    assert not any("<dc:date>" in svg for svg in text.values())


@pytest.mark.parametrize(
    ("form", "magic"), [("png", b"\x89PNG"), ("svg", b"<?xml"), ("pdf", b"%PDF")]
)
def test_charts_are_kept_in_any_format(
    short: Path, sheet: Path, tmp_path: Path, form: str, magic: bytes
) -> None:
    twice = [
        make_report([short], tmp_path / name, form=form, sheet=str(sheet)).files
        for name in ("a", "b")
    ]
    assert len(twice[0]) == 3
    for one, other in zip(*twice):
        assert one.read_bytes() == other.read_bytes()
    assert all(path.suffix == f".{form}" for path in twice[0][1:])
    assert all(path.read_bytes().startswith(magic) for path in twice[0][1:])
    assert "data:image/png;base64," in twice[0][0].read_text()


def test_the_users_style_wins(
    short: Path, sheet: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def latency(name: str, sheet: Path | None) -> tuple[int, int]:
        made = make_report([short], tmp_path / name, sheet=sheet and str(sheet))
        return size_px(next(f for f in made.files if f.stem == "latency").read_bytes())

    assert latency("ours", None) == (1050, 690)
    assert latency("sheet", sheet) == (200, 120)
    (tmp_path / "here").mkdir()
    (tmp_path / "here" / "matplotlibrc").write_text("savefig.dpi: 30\ntext.usetex: True\n")
    monkeypatch.chdir(tmp_path / "here")
    assert latency("still ours", None) == (1050, 690), "the current folder's does not count"
    (tmp_path / "matplotlibrc").write_text("savefig.dpi: 60\nfont.size: 10\n")
    monkeypatch.setenv("MATPLOTLIBRC", str(tmp_path))
    assert latency("file", None) == (210, 138)
    assert latency("both", sheet) == (200, 120)
    with _plot.styled("ggplot"):
        assert _plot.setting("axes.facecolor") == "#E5E5E5" and _plot.setting("savefig.dpi") == 60


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "expected a Matplotlib style sheet"),
        (b"no.such: 1\n", "Bad key no.such in file"),
        (b"savefig.dpi: many\n", "line 1 ('savefig.dpi: many')"),
        (b"\xff\xfe", "can't decode byte 0xff"),
    ],
)
def test_a_bad_style_is_one_line(
    recording: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str], content, words: str
) -> None:
    sheet, folder = tmp_path / "bad.mplstyle", tmp_path / "report"
    if content is not None:
        sheet.write_bytes(content)
    assert cli.main(["report", str(recording), "-o", str(folder), "--style", str(sheet)]) == 2
    told = capfd.readouterr().err
    assert told.startswith(f"vsense: --style {sheet}: ") and told.count("\n") == 1
    assert words in told
    assert not folder.exists()


def test_without_matplotlib_there_is_all_but_charts(
    recording: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    for name in [name for name in sys.modules if name.split(".")[0] == "matplotlib"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    folder = tmp_path / "report"
    command = ["report", str(recording), str(recording), "-o", str(folder)]
    for drawing in (("--style", "ggplot"), ("--format", "svg")):
        assert cli.main([*command, *drawing]) == 2 and not folder.exists()
        assert lacking() in capsys.readouterr().err
    assert cli.main(command) == 0
    out, err = capsys.readouterr()
    assert out == f"{folder / REPORT_PAGE}: 0 charts beside it\n"
    assert err.count(lacking()) == 1
    assert [path.name for path in folder.iterdir()] == [REPORT_PAGE]
    text = (folder / REPORT_PAGE).read_text()
    assert "pip install &#x27;matplotlib&gt;=3." in text and "<img" not in text
    assert re.search("<b>Table 1. Runs of hand.</b>.*<td>driver</td>", text, re.DOTALL)


def test_any_name_is_drawn_as_it_stands() -> None:
    with _plot.styled():
        figure = _plot.new_figure()
        figure.subplots().set_xlabel(_plot.measure_label("$x_1$ \\frac{ % \ud800_m"))
        assert ">$x 1$ \\frac{ % ? [m]</text>" in _plot.encode(figure, "svg").decode()


def test_a_long_run_is_thinned_to_what_can_be_seen() -> None:
    values = np.sin(np.arange(100_000.0))
    values[70_123] = 5.0
    with _plot.styled():
        axes = _plot.new_figure().subplots()
        _plot.steps(axes, np.arange(100_000.0), values, "C0")
        shown = axes.lines[0].get_xydata()
    assert len(shown) <= 4 * _plot.MOST_PLACES
    assert [70_123.0, 5.0] in shown.tolist() and shown[-1, 0] == 99_999.0
    assert (np.diff(shown[:, 0]) > 0.0).all()


def test_latex_gets_what_it_needs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sheet = tmp_path / "tex.mplstyle"
    sheet.write_text("text.usetex: True\n")
    monkeypatch.setenv("PATH", str(tmp_path))
    with _plot.styled(str(sheet)):
        assert _plot.label("50 % of a_b") == r"50 \% of a\_b"
        figure = _plot.new_figure()
        figure.suptitle("words")
        with pytest.raises(VsenseError, match="latex"):
            _plot.encode(figure, "png")
    with pytest.raises(UsageError), _plot.styled(str(tmp_path)):
        pass


@pytest.mark.parametrize(
    ("text", "letters", "lines"),
    [
        ("sensor.noise=0.2", 9, ["sensor.", "noise=0.2"]),
        ("sensor.noise=0.25, robots=-12", 9, ["sensor.", "noise=", "0.25,", "robots=", "-12"]),
        ("blind", 9, ["blind"]),
        ("wholly blind", 9, ["wholly", "blind"]),
        ("proximities=1", 9, ["proximities=", "1"]),
        ("a" * 20, 9, ["a" * 13, "a" * 7]),
        ("", 9, [""]),
    ],
)
def test_names_of_conditions_break_where_people_read_a_pause(
    text: str, letters: int, lines: list[str]
) -> None:
    assert _plot.wrapped(text, letters).splitlines() == [line for line in lines if line]
