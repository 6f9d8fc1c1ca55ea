"""What a person sees while tuning."""

from __future__ import annotations

import json

import numpy as np

from tests.tools.camera_setup.stage import Scripted, tuner
from vsense.base.terminal import LiveBlock
from vsense.tools.camera_setup import _panel
from vsense.tools.camera_setup._advice import brightness
from vsense.tools.camera_setup._panel import WIDTH, PanelView, histogram


def view() -> PanelView:
    scripted = Scripted()
    made = tuner(scripted)
    return made.view(made.camera.picture().image, made.camera.picture().image, 25.0)


def test_block_says_all_that_matters() -> None:
    lines = _panel.lines(view())
    text = "\n".join(lines)
    assert lines[0] == "cam: 640 x 480 px, 25.0 pictures/s, exposure 10000 us, gain 0"
    for word in ("light ", "saturated", "noise ", "blur ", "markers ", "advice "):
        assert word in text, text
    assert "px/m (size of the markers)" in text
    assert all(len(line) <= WIDTH for line in lines)


def test_unknown_things_say_what_would_tell_them() -> None:
    scripted = Scripted()
    scripted.values["exposure_time_abs"] = 1.0
    made = tuner(scripted)
    shown = made.view(made.camera.picture().image, made.camera.picture().image, None)
    text = "\n".join(_panel.lines(shown))
    assert "markers   none of arrow4x4" in text
    assert "blur      unknown: no marker in the picture gives its scale; give --px-per-m" in text
    assert "noise     unknown" in text


def test_histogram_is_tall_where_the_pixels_are() -> None:
    counts = np.zeros(256, np.int64)
    counts[100], counts[200] = 10_000, 100
    rows = histogram(counts)
    assert [len(row) for row in rows] == [_panel.BAR_COLUMNS] * _panel.ROWS
    assert [row[100 // 8] for row in rows] == ["█"] * _panel.ROWS
    assert rows[-1][200 // 8] != " " and rows[0][200 // 8] == " "
    assert set("".join(histogram(counts, blocks=False))) <= set(" .:|#")


def test_an_empty_histogram_is_empty() -> None:
    assert "".join(histogram(np.zeros(256, np.int64))).strip() == ""


def test_facts_are_data() -> None:
    shown = view()
    facts = json.loads(json.dumps(_panel.facts(shown)))
    assert facts["tags"] == [31, 1843, 4334, 7167] and facts["markers"] == 4
    assert sum(facts["histogram"]) == 640 * 480
    assert facts["exposure_us"] == 10_000.0 and facts["px_per_m_from"] == "size of the markers"


def test_many_numbers_do_not_break_the_line() -> None:
    text = _panel._numbers(list(range(10_000, 10_040)))
    assert text.endswith("more") and len(text) < WIDTH - 20
    assert _panel._numbers([]) == "no number could be read"


class Terminal:
    """A stream that says it is a terminal, or is not."""

    def __init__(self, live: bool, encoding: str = "utf-8") -> None:
        self.live, self.encoding, self.written = live, encoding, ""

    def isatty(self) -> bool:
        return self.live

    def write(self, text: str) -> None:
        self.written += text

    def flush(self) -> None:
        pass


def test_a_block_is_drawn_over_itself() -> None:
    terminal = Terminal(True)
    block = LiveBlock(terminal)  # type: ignore[arg-type]
    block.draw(["one", "two"])
    block.draw(["three"])
    assert terminal.written == "one\ntwo\n\x1b[2A\r\x1b[Jthree\n"
    block.draw(["x" * 500])
    assert len(terminal.written.splitlines()[-1]) < 500, "a broken line would be two"


def test_a_pipe_gets_no_escapes() -> None:
    pipe = Terminal(False, "ascii")
    block = LiveBlock(pipe)  # type: ignore[arg-type]
    block.draw(["one"])
    block.draw(["x" * 500])
    assert pipe.written == "one\n" + "x" * 500 + "\n"
    assert not block.has_blocks and LiveBlock(Terminal(False)).has_blocks  # type: ignore[arg-type]


def test_brightness_of_the_scripted_camera_follows_exposure() -> None:
    scripted = Scripted()
    means = []
    for exposure_us in (1000.0, 2000.0, 4000.0):
        scripted.values["exposure_time_abs"] = exposure_us
        means.append(brightness(scripted.read().image).mean)
    assert means[1] > 1.7 * means[0] and means[2] > 1.7 * means[1]
