"""A sweep over exposures and gains of a camera whose brightness follows them."""

from __future__ import annotations

import json
import threading

import pytest

from tests.tools.camera_setup.stage import GONE, Scripted, tuner
from vsense.base.errors import GrabberError, VsenseError
from vsense.tools.camera_setup import _sweep
from vsense.tools.camera_setup._panel import PanelView
from vsense.tools.camera_setup._sweep import exposures, gains, scaled, tried, worth
from vsense.vision.cameras.source import EXPOSURE, GAIN
from vsense.vision.tracking.single_camera import OpenCamera


@pytest.fixture(scope="module")
def measured() -> list[PanelView]:
    """The rows of a sweep."""
    scripted = Scripted()
    return scaled(list(tried(tuner(scripted), scripted, threading.Event())))


def test_the_best_row_is_bright_sharp_and_quiet(measured: list[PanelView]) -> None:
    best = max(measured, key=worth)
    light = best.reading.light
    assert best.markers.tags == (31, 1843, 4334, 7167)
    assert light.saturated < 0.01 and light.light > 150
    assert best.reading.gain == 0.0, "light enough without gain, which would bring noise"
    assert not best.reading.is_blurred


def test_gain_is_raised_only_where_the_picture_is_dark(measured: list[PanelView]) -> None:
    by_exposure: dict[float | None, list[float | None]] = {}
    for row in measured:
        by_exposure.setdefault(row.reading.exposure_us, []).append(row.reading.gain)
    assert by_exposure[200.0] == [0.0, 8.0, 16.0, 24.0]
    assert by_exposure[10_000.0] == [0.0]


def test_all_rows_get_the_scale_that_one_has_told(measured: list[PanelView]) -> None:
    assert measured[0].markers.count == 0, "far too dark"
    assert measured[0].reading.blur_px == pytest.approx(0.13 * 200e-6 * 700.0, rel=0.1)


def test_own_values_are_back_and_told(capsys: pytest.CaptureFixture[str]) -> None:
    scripted = Scripted()
    assert _sweep.run(tuner(scripted), threading.Event(), False)
    assert scripted.values == {EXPOSURE: 10_000.0, GAIN: 0.0} and scripted.turned
    out, err = capsys.readouterr()
    assert err == "vsense: cam: has its own values again: exposure_time_abs 10000, gain_raw 0\n"
    marked = [line for line in out.splitlines() if line.startswith("*")]
    assert len(marked) == 2 and 'For the resources file:  exposure_time_abs="' in marked[1]


def test_json_is_one_object(capsys: pytest.CaptureFixture[str]) -> None:
    _sweep.run(tuner(Scripted()), threading.Event(), True)
    told = json.loads(capsys.readouterr().out)
    assert told["best"] in told["rows"] and len(told["rows"]) > 8


def test_ctrl_c_puts_the_values_back_and_concludes_nothing(
    capsys: pytest.CaptureFixture[str],
) -> None:
    scripted, interrupted = Scripted(), threading.Event()
    scripted.after_read = lambda reads: interrupted.set() if reads == 20 else None
    _sweep.run(tuner(scripted), interrupted, False)
    assert scripted.values == {EXPOSURE: 10_000.0, GAIN: 0.0}
    out, err = capsys.readouterr()
    assert "best" not in out and "own values again" in err


def test_unplugged_in_the_middle_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    scripted = Scripted()

    def unplug(reads: int) -> None:
        scripted.fails = GONE if reads == 30 else None

    scripted.after_read = unplug
    with pytest.raises(GrabberError, match=r"cam:.*0.4 s"):
        _sweep.run(tuner(scripted), threading.Event(), False)
    assert scripted.values == {EXPOSURE: 10_000.0, GAIN: 0.0}
    out, err = capsys.readouterr()
    assert "own values again" in err
    assert out == "", "nothing is concluded from what was measured until then"


def test_values_that_are_not_put_back_are_told(capsys: pytest.CaptureFixture[str]) -> None:
    scripted = Scripted()
    scripted.keeps = "exposure_time_abs: timeout"
    assert not _sweep.run(tuner(scripted), threading.Event(), False)
    told = capsys.readouterr().err
    assert told == "vsense: cam: not put back: exposure_time_abs: timeout\n"


def test_a_camera_that_falls_silent_is_not_said_to_be_as_it_was(
    capsys: pytest.CaptureFixture[str],
) -> None:
    scripted = Scripted()

    def silence(reads: int) -> None:
        if reads == 30:
            scripted.fails, scripted.keeps = GONE, "exposure_time_abs: timeout"

    scripted.after_read = silence
    with pytest.raises(GrabberError, match=r"cam:.*pictures"):
        _sweep.run(tuner(scripted), threading.Event(), True)
    out, err = capsys.readouterr()
    assert out == "" and err == "vsense: cam: not put back: exposure_time_abs: timeout\n"


def test_a_camera_without_controls_has_nothing_to_try() -> None:
    made = tuner(Scripted())
    made.camera = OpenCamera("stream", Scripted(), None)
    with pytest.raises(VsenseError, match=r"stream:.*exposure"):
        _sweep.run(made, threading.Event(), False)


@pytest.mark.parametrize(
    ("bounds", "longest_us", "expected"),
    [
        (None, None, [200, 500, 1000, 2000, 5000, 10_000, 20_000, 32_000]),
        ((1000.0, 4000.0), None, [1000, 2000, 4000]),
        ((10.0, 1e7), 9000.0, [200, 500, 1000, 2000, 5000, 9000]),
        ((50_000.0, 1e7), None, [32_000]),
    ],
)
def test_exposures_to_try(
    bounds: tuple[float, float] | None, longest_us: float | None, expected: list[float]
) -> None:
    assert exposures(bounds, 0.0053, 0.13, longest_us) == expected


def test_exposures_of_robots_that_stand_still_end_somewhere() -> None:
    assert 1e5 < exposures((10.0, 1e7), 0.0053, 0.0, None)[-1] < 1e6


def test_gains_to_try() -> None:
    assert gains((0.0, 10.0)) == [0, 3, 7, 10]
    assert gains((0.0, 24.5)) == pytest.approx([0.0, 24.5 / 3, 49 / 3, 24.5], abs=0.5)
    assert gains((0.0, 1.5)) == [0.0, 0.5, 1.0, 1.5]
    assert gains(None) == [None] and gains((3.0, 3.0)) == [None]
