"""What a designer would measure on the page: sizes, type, contrast, names that touch nothing."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path
from typing import Any

import pytest

from tests.monitor.ui.browser import Page
from tests.monitor.ui.conftest import Open, Serve
from tests.monitor.ui.puppet import running

LARGE_PX = (1600, 1000)
LEAST_PX = 12
TEXT, DISABLED = 4.5, 3.0
"""WCAG 2.1, level AA: of text, and what is asked of buttons that cannot be pressed now."""

TEXTS = Path(__file__).with_name("texts.js").read_text()
BOX = (
    "(s => { const b = document.querySelector(s).getBoundingClientRect();"
    " return [b.x, b.y, b.width, b.height] })"
)


def box(page: Page, selector: str) -> list[float]:
    """Left, top, width and height of an element [px]."""
    found: list[float] = page.value(f"{BOX}({selector!r})")
    return found


@pytest.mark.parametrize("dark", [False, True])
def test_all_text_is_large_enough_and_can_be_read(served: Serve, opened: Open, dark: bool) -> None:
    puppet, _, url = served(running())
    puppet.trouble = {puppet.swarm.tags[3]: "link lost for 3.2 s"}
    puppet.camera_trouble = {1: ("lost", "no picture for 12 s")}
    page = opened(url)
    page.size(*LARGE_PX)
    page.dark(dark)
    puppet.say("something happened", level="trouble")
    # Before them there is no robot to choose, and nothing to change.
    page.until("vsense.store.robots && vsense.edit.able")
    page.key("j")
    page.key("e")
    page.until("document.querySelector('#readings .chartable') && vsense.edit.on")
    page.until("document.querySelector('#events .trouble') && vsense.store.pictures.size > 2")
    for key, shown in ((None, "running"), ("P", "running"), ("Escape", "emergency")):
        if key:
            page.key(key)
        page.until(f"document.body.dataset.state === '{shown}'")
        texts: list[dict[str, Any]] = page.value(TEXTS)
        assert len(texts) > 100
        assert [text for text in texts if text["px"] < LEAST_PX] == []
        # A caption lies over a picture, on a shade of its own.
        solid = [text for text in texts if not text["inPicture"]]
        pale = [t for t in solid if t["contrast"] < (DISABLED if t["disabled"] else TEXT)]
        assert pale == []
        reasons = [text["reason"] for text in texts if text["disabled"] and text["reason"]]
        assert reasons and all("not while the run is" in why or why for why in reasons)


def test_pictures_are_as_large_as_their_worth(served: Serve, opened: Open) -> None:
    _, _, url = served(running())
    page = opened(url)
    page.size(*LARGE_PX)
    page.until("innerWidth === 1600 && document.querySelectorAll('.measure').length === 2")
    assert box(page, "#cameras_panel")[2] >= 0.4 * LARGE_PX[0]
    assert box(page, "#arena")[2] >= 0.33 * LARGE_PX[0] and box(page, "#arena")[3] > 400
    assert box(page, ".measure canvas")[3] >= 120
    rows = page.value("document.querySelector('#events').scrollHeight")
    assert box(page, ".events")[3] <= rows + 60, "as high as what stands in it"
    assert page.text("#robots").splitlines()[1].split("\t")[0].strip() == "11"
    page.click(".cell")
    page.until("document.querySelector('.cell.alone')")
    cell, panel = box(page, ".cell.alone"), box(page, "#cameras")
    assert cell[2] > 0.95 * (panel[2] - 20) and cell[3] > 0.95 * (panel[3] - 20)
    page.click("[data-view=cameras]")
    page.until(f"{BOX}('#cameras_panel')[2] > 0.7 * innerWidth")
    page.click("[data-view=both]")
    # What is answered stands between the buttons, and lies over nothing.
    page.value("vsense.controls.notify('a'.repeat(30) + ' ' + 'b'.repeat(30), false)")
    page.value("vsense.controls.notify('the newest alone', false)")
    assert page.value("document.querySelectorAll('.toast').length") == 1
    _, top, _, height = box(page, ".toast")
    assert top + height <= box(page, "main")[1]


def test_an_arena_that_is_changed_stays_large_on_a_small_screen(
    served: Serve, opened: Open
) -> None:
    _, _, url = served(running())
    page = opened(url)
    page.size(1366, 768)
    page.until("innerWidth === 1366 && vsense.store.robots && vsense.edit.able")
    # The charts of the measures, which come with the first timesteps, take some of its room.
    page.until("document.querySelector('#measures').childElementCount > 0")
    _, _, width, height = box(page, "#arena")
    page.key("e")
    page.until("document.querySelector('#edit_save').offsetParent")
    _, _, then_width, then_height = box(page, "#arena")
    assert then_width >= width - 1 and then_height >= 0.9 * height


def test_a_toast_of_a_phone_covers_neither_the_top_line_nor_the_emergency_stop(
    served: Serve, opened: Open
) -> None:
    _, _, url = served(running())
    page = opened(url)
    page.size(390, 844)
    page.until("innerWidth === 390")
    page.value("vsense.controls.notify('cannot start: the run is running', false)")
    left, top, width, height = box(page, ".toast")
    assert left >= 0 and left + width <= 390
    assert page.value("document.querySelector('#emergency kbd').offsetParent") is None
    assert top > 300 and top + height <= box(page, "#emergency")[1]


def test_a_sensed_colour_has_its_numbers_and_its_colour(served: Serve, opened: Open) -> None:
    puppet, _, url = served(running())
    page = opened(url)
    page.value(f"vsense.choice.choose({puppet.swarm.tags[1]})")
    page.until("document.querySelectorAll('#readings .bars').length === 2")
    puppet.silent = True
    # What was on its way may still come, and is written over again.
    page.value(
        "setInterval(() => { vsense.store.experiment.controllers[0].sensors[1] ="
        " { name: 'rgb_ground', layout: '4*u1', count: 4 };"
        " for (const r of vsense.store.readings.values()) r.values[0][1] = [200, 40, 10, 255];"
        " }, 50)"
    )
    cell = "document.querySelector('#readings').rows[1].cells[1]"
    page.until(f"{cell}.innerText === '200, 40, 10, 255'")
    assert page.value(f"getComputedStyle({cell}.querySelector('i')).backgroundColor") == (
        "rgb(200, 40, 10)"
    )
    assert page.value(f"{cell}.scrollWidth <= {cell}.clientWidth"), "nothing is cut"


def test_names_touch_neither_each_other_nor_walls(served: Serve, opened: Open) -> None:
    puppet, _, url = served(running(60))
    page = opened(url)
    page.size(*LARGE_PX)
    tag = puppet.swarm.tags[7]
    page.value(f"vsense.choice.choose({tag})")
    page.until(f"vsense.arena.names.boxes.some(box => box.tag === {tag})")
    page.until("[...vsense.cameras.cells.values()].every(cell => cell.names.boxes.length)")
    for _ in range(5):
        drawn = page.value("vsense.arena.drawn.count")
        page.until(f"vsense.arena.drawn.count > {drawn} + 2")
        boxes, edges, bar, tiles = page.value(
            "[vsense.arena.names.boxes, vsense.arena.view.edges, vsense.arena.view.scaleBar,"
            " [...vsense.cameras.cells.values()].map(cell => cell.names.boxes)]"
        )
        assert 20 < len(boxes) <= 62 and any(row["tag"] == tag for row in boxes)
        for names in (boxes, *tiles):
            assert [pair for pair in combinations(names, 2) if touch(*pair)] == []
        others = [row for row in boxes if row["tag"] != tag]
        assert not any(touch(row, bar) for row in others)
        left, top, width, height = edges
        assert all(row["left"] > left and row["right"] < left + width for row in boxes)
        assert all(row["top"] > top and row["bottom"] < top + height for row in boxes)
        assert all(row["top"] >= 24 for names in tiles for row in names if row["tag"] != tag)


def touch(a: dict[str, float], b: dict[str, float]) -> bool:
    """Whether two boxes overlap."""
    across = a["left"] < b["right"] and b["left"] < a["right"]
    return across and a["top"] < b["bottom"] and b["top"] < a["bottom"]
