"""The page changes the world, charts numbers, shows alarms; and the page without controls."""

from __future__ import annotations

import pytest

from tests.monitor.ui.browser import Page
from tests.monitor.ui.conftest import Open, Serve
from tests.monitor.ui.puppet import Puppet, running
from vsense.monitor.ui.access import Tokens
from vsense.run.changing import ChangeKind

WIDTHS_PX = (390, 800, 1600)


def place(page: Page, x_m: float, y_m: float) -> tuple[float, float]:
    """Where a place of the arena is in the window."""
    x, y = page.value(
        "(() => { const { canvas, view } = vsense.arena, box = canvas.getBoundingClientRect();"
        f" return [box.x + view.x({x_m}) / view.ratio, box.y + view.y({y_m}) / view.ratio];"
        " })()"
    )
    return x, y


def fits(page: Page) -> None:
    """Nothing is wider than the window."""
    for width in WIDTHS_PX:
        page.size(width, 900)
        page.until(f"innerWidth === {width} && document.documentElement.scrollWidth <= {width}")


def test_the_head_says_which_run_of_a_plan_it_is(served: Serve, opened: Open) -> None:
    puppet = running()
    cell = {"condition": "with a long name", "start": "scattered", "repetition": 2, "attempt": 3}
    puppet.made = {"series": {"name": "trails", "number": 6, "of": 12, **cell}}
    page = opened(served(puppet)[2])
    text = "series trails: with a long name, start scattered, repetition 2, attempt 3"
    page.until(f"document.querySelector('#what').innerText.startsWith('run 6 of 12 · {text}')")
    for width in WIDTHS_PX[:2]:
        page.size(width, 900)
        page.until(f"innerWidth === {width} && what.scrollWidth <= what.clientWidth")


def test_things_are_dragged_and_numbers_are_set(served: Serve, opened: Open) -> None:
    puppet, _, url = served(running())
    page = opened(url)
    page.until("vsense.store.world && vsense.store.settings && vsense.arena.view")
    page.until("!document.querySelector('#edit').hidden")
    page.drag(place(page, 1.0, 0.7), place(page, 0.4, 0.5))
    assert puppet.changes == [], "nothing is moved by mistake"
    page.key("e")
    page.until("vsense.edit.on && !document.querySelector('#editor').hidden")
    page.until("(vsense.arena.key = '', vsense.arena.draw(), true)")
    page.drag(place(page, 1.0, 0.7), place(page, 0.4, 0.5))
    page.until("vsense.store.world.entities.some(e => e.id === 'nest' && e.x_m < 0.5)")
    assert {change.name for change in puppet.changes} == {"nest"}
    last = puppet.changes[-1]
    assert last.final and (last.x_m, last.y_m) == pytest.approx((0.4, 0.5), abs=0.02)
    page.value("document.querySelector('#edit_target').selectedIndex = 0")
    page.value("document.querySelector('#edit_target').dispatchEvent(new Event('change'))")
    assert page.value("document.querySelector('#edit_setting').value") == "noise_level"
    # Where a person types is in focus: the row is not renewed from the world meanwhile.
    page.value("document.querySelector('#edit_value').focus()")
    page.value("document.querySelector('#edit_value').value = '0.25'")
    page.click("#edit_form button")
    page.until("vsense.store.settings.sensors[0].noise_level === 0.25")
    page.click("#edit_add")
    page.click_at(*place(page, -0.5, 0.9))
    page.until("!vsense.edit.adding")
    page.until("vsense.store.settled >= vsense.edit.asked")
    added = puppet.changes[-1]
    assert added.kind is ChangeKind.ADD and added.x_m == pytest.approx(-0.5, abs=0.02)
    lost = "vsense.edit.asked += 5, vsense.edit.moved = -1e9"
    settled = "vsense.store.settled === vsense.edit.asked"
    page.value(lost)
    page.drag(place(page, 0.4, 0.5), place(page, 0.5, 0.7))
    page.until(settled)
    page.drag(place(page, -0.9, 0.55), place(page, -0.9, 0.2))
    page.until("document.querySelector('#toasts').innerText.includes('stands in the real arena')")
    page.value(f"{lost}, vsense.connection.socket.close()")
    page.until(f"vsense.connection.open && {settled}")
    fits(page)


def test_who_is_locked_out_changes_nothing_and_is_told(served: Serve, opened: Open) -> None:
    puppet = running()
    puppet.locked = True
    _, _, url = served(puppet)
    page = opened(url)
    page.until("document.querySelector('#edit').innerText === 'locked'")
    page.click("#edit")
    page.until("document.querySelector('#toasts').innerText.includes('this run is locked')")
    assert not page.value("vsense.edit.on")
    assert puppet.changes == []


def test_a_click_shows_a_number_over_time_and_alarms_are_banners(
    served: Serve, opened: Open
) -> None:
    puppet, _, url = served(running())
    page = opened(url)
    names = "[...document.querySelectorAll('.measure')].map(m => m.dataset.chart)"
    page.until(f"{names}.join() === 'in the cone,LEDs on'")
    tag = puppet.swarm.tags[1]
    page.value(f"vsense.choice.choose({tag})")
    page.until("document.querySelector('#readings .chartable')")
    page.value("document.querySelector('#readings').rows[1].cells[1].click()")
    page.value("[...document.querySelectorAll('.tile.chartable')][1].click()")
    page.until(f"{names}.length === 4")
    page.value("vsense.choice.choose(null)")
    series = f"[...vsense.measures.series].find(([key]) => key.startsWith('{tag}/reading'))[1]"
    count = page.value(f"{series}.times.length")
    page.until(f"{series}.times.length > {count} + 1")
    assert page.value(f"{series}.last.length") > 1, "all numbers of a sensor"
    fits(page)
    page.value("document.querySelector('.measure button').click()")
    page.until(f"{names}.length === 3")
    # What is worst has a banner of its own.
    puppet.alarms = [
        {"kind": "no_link", "text": "epuck_7 moves without a link", "cause": "lift it off"},
        {"kind": "overload", "text": "this computer makes 3 of 10", "cause": "tracking takes 300"},
    ]
    page.until("document.querySelectorAll('#alarms .banner').length === 2")
    assert page.text("#alarms").splitlines()[:2] == ["Epuck_7 moves without a link", "lift it off"]
    assert page.value("document.querySelector('#banner').hidden")
    fits(page)
    puppet.alarms = []
    page.until("!document.querySelector('#alarms').childElementCount")


def test_a_sought_replay_keeps_its_chart(served: Serve, opened: Open) -> None:
    _, _, url = served(Puppet(mode="replay"))
    page = opened(url)
    page.until("document.body.dataset.mode === 'replay' && vsense.store.now")
    page.key(" ")
    line = "vsense.store.measures.get('LEDs on').times"
    page.until(f"({line}).length > 5")
    page.value("vsense.controls.order('seek', 60)")
    page.until(f"({line}).at(-1) > 60")
    page.value("vsense.controls.order('seek', 0.1)")
    page.until("vsense.store.now.time_s < 30")
    page.until(
        f"({line}).at(-1) > 60 && ({line}).every((time, at, all) => !at || time > all[at-1])"
    )


def test_a_replay_draws_no_poses_of_now_over_old_pictures(served: Serve, opened: Open) -> None:
    puppet = Puppet(mode="replay")
    puppet.unrecorded = {1}
    _, _, url = served(puppet)
    page = opened(url)
    page.key(" ")
    words = "[...document.querySelectorAll('.cell strong')].map(e => e.innerText)"
    states = "[...document.querySelector('#watch').tBodies[0].rows].map(r => r.cells[3].innerText)"
    page.until(f"{words}.join() === ',no picture is recorded here,,'")
    page.until(f"{states}.join() === 'ok,no picture is recorded here,ok,ok'")
    puppet.unrecorded = {0, 1}
    page.until(f"{words}[0].includes('s old')")
    age = float(str(page.value(f"{words}[0]")).split()[-3])
    assert 1.5 < age < 10
    rings = (
        "[0, 2].map(at => { const cell = [...vsense.cameras.cells.values()][at];"
        " const { width, height } = cell.canvas;"
        " const data = cell.pen.getImageData(0, 24, width, height - 24).data; let n = 0;"
        " for (let k = 0; k < data.length; k += 4)"
        " n += data[k] < 90 && data[k + 1] > 180 && data[k + 2] > 220; return n; })"
    )
    page.until(f"{rings}[0] === 0")
    assert page.value(f"{rings}[1]") > 50, "a picture of now has the rings of now"
    # Sought back, the picture is one of later.
    page.value("vsense.controls.order('seek', 0.1)")
    page.until(f"{words}[0].includes('s younger') || {words}[0].includes('s old')")
    page.until(f"{rings}[0] === 0")


def test_the_page_without_controls_falls_onto_the_floor(served: Serve, opened: Open) -> None:
    _, _, url = served(running(), Tokens("to-look-only", "to-control-it"))
    page = opened(url.replace("/?token=to-control-it", "/screen?token=to-look-only"))
    assert page.value("document.querySelector('.emergency, [data-order]')") is None
    page.until("document.querySelector('#figures').innerText.includes('in the cone')")
    page.until("document.querySelector('#state').innerText === 'Running'")
    page.key("c")
    page.until("!document.querySelector('#corners').hidden")
    page.until("document.querySelector('#corners button').offsetLeft > 0")
    x, y = page.value(
        "(() => { const box = document.querySelector('#corners button').getBoundingClientRect();"
        " return [box.x + box.width / 2, box.y + box.height / 2]; })()"
    )
    page.drag((x, y), (x + 150, y + 60))
    page.until("document.querySelector('#arena').style.transform.startsWith('matrix3d')")
    # The browser's own arithmetic takes the arena's corner to where it was dragged.
    found = page.value(
        "(() => { const at = vsense.drawnCorners()[0];"
        " const point = new DOMMatrix(document.querySelector('#arena').style.transform)"
        ".transformPoint(new DOMPoint(...at));"
        " return [point.x / point.w, point.y / point.w]; })()"
    )
    assert found == pytest.approx([x + 150, y + 60], abs=1.0)
    page.key("r")
    page.until("!document.querySelector('#arena').style.transform")
