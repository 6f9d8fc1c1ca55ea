"""The search plans on hard pictures: what is found is the same wherever it runs."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from vsense import cli
from vsense.tools.bench import trade_off
from vsense.tools.bench.frames import FrameSet
from vsense.tools.bench.trade_off import THESIS, PlanRow, Spoiler, hard_frames


@pytest.fixture(scope="module")
def frames() -> FrameSet:
    return hard_frames(4)


def test_the_pictures_are_hard_and_the_same_every_time(frames: FrameSet) -> None:
    grey = np.full((120, 400), 200, dtype=np.uint8)
    one, again = (Spoiler(grey.shape)(3, grey) for _ in range(2))
    assert np.array_equal(one, again) and not np.array_equal(one, Spoiler(grey.shape)(4, grey))
    moved = np.hypot(*(frames.truth[1].centres_px - frames.truth[0].centres_px).T)
    assert moved.max() < 16.0, "12 cm/s, 133 ms and 1.5 mm/px: 11 px"
    # Black and white are 205 and 30 grey values in the easy ones.
    assert np.subtract(*np.percentile(frames.images[0], (99.9, 0.1))) < 90.0


def test_the_report_has_the_rows_of_the_thesis(
    frames: FrameSet,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(trade_off, "hard_frames", lambda timesteps: frames)
    pytest.importorskip("matplotlib", reason="charts: pip install matplotlib")
    chart = tmp_path / "plans.png"
    words = ["bench", "tracking", "--plans", "--rounds", "1", "--walk", "4", "--json"]
    assert cli.main([*words, "-o", str(chart)]) == 0
    (rows,) = json.loads(capsys.readouterr().out).values()
    told = [PlanRow(**row) for row in rows]
    assert {(r.key_frame_period, r.window_m): r.thesis_mean for r in told if r.thesis_mean} == (
        THESIS
    )
    assert [told[0].label, told[1].label] == ["1", "5_8"]
    assert all(row.mean == row.detected_share * 20 for row in told), "four pictures of all 20"
    assert chart.read_bytes().startswith(b"\x89PNG")
    assert "5          30 cm" in trade_off.table(rows)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["tracking", "-o", "plans.txt"], "expected a name that ends in .png, .svg, .pdf"),
        (["tracking", "-o", "nowhere/plans.png"], "there is no folder nowhere"),
        (["world", "--plans"], "--plans: 'vsense bench world' has none"),
        (["sim", "-o", "x.png"], "--output: 'vsense bench sim' has none"),
    ],
)
def test_what_cannot_be_drawn_is_said_before_anything_is_measured(
    arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["bench", *arguments]) in (1, 2)
    captured = capsys.readouterr()
    assert words in captured.err and len(captured.err.splitlines()) == 1
