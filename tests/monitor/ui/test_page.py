"""The page in a real browser: what a person sees and presses."""

from __future__ import annotations

import socket
import time

import pytest

from tests.monitor.ui.browser import Browser, Page
from tests.monitor.ui.conftest import Open, Serve
from tests.monitor.ui.portrait import PLACES, state
from tests.monitor.ui.puppet import Puppet, running
from vsense.monitor.ui._server import WebServer
from vsense.monitor.ui.access import Tokens
from vsense.run.orders import Order, OrderKind

PIXELS = """(() => {
  const canvas = document.querySelector("#arena");
  const data = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
  let sum = 0;
  for (let at = 0; at < data.length; at += 4) sum = (sum * 31 + data[at] * 7 + data[at + 1]) % 1e9;
  return sum;
})()"""
TOKENS = Tokens("to-look-only", "to-control-it")


def test_fifteen_robots_move_on_the_page(served: Serve, opened: Open) -> None:
    _, _, url = served(running())
    page = opened(url)
    page.until("vsense.arena.drawn.robots.length === 16")
    places, pixels, drawn = page.value(f"[{PLACES}, {PIXELS}, vsense.arena.drawn.count]")
    page.until(f"vsense.arena.drawn.count >= {drawn} + 10")
    assert page.value(PLACES) != places
    assert page.value(PIXELS) != pixels


def test_robots_are_drawn_where_they_are(served: Serve, opened: Open) -> None:
    puppet, _, url = served(Puppet())
    page = opened(url)
    page.until("vsense.arena.drawn.robots.length === 16")
    drawn = {r["tag"]: r for r in page.value("vsense.arena.drawn.robots")}
    first, second = puppet.swarm.tags[:2]
    moved_px = (
        drawn[second]["x_px"] - drawn[first]["x_px"],
        drawn[second]["y_px"] - drawn[first]["y_px"],
    )
    moved_m = puppet.swarm.places[1] - puppet.swarm.places[0]
    assert moved_px[0] / moved_m[0] == pytest.approx(-moved_px[1] / moved_m[1], rel=0.02)
    assert moved_px[0] / moved_m[0] > 100, "+x to the right, +y upwards"


def test_buttons_reach_the_desk_and_the_page_shows_the_new_state(
    served: Serve, opened: Open
) -> None:
    puppet, _, url = served()
    page = opened(url)
    state(page, "ready")
    for button, then in (
        ("start", "running"), ("pause", "paused"), ("start", "running"), ("stop", "ended"),
        ("reset", "ready"),
    ):  # fmt: skip
        page.until(f"!document.querySelector('#{button}').disabled")
        page.click(f"#{button}")
        state(page, then)
        assert puppet.orders[-1].kind.value == button
        assert puppet.orders[-1].by == "viewer 1 (127.0.0.1)"
    assert "run 2" in page.text("#what")
    assert page.text("#what").endswith("anna’s")


def test_record_goes_on_and_off(served: Serve, opened: Open) -> None:
    puppet, _, url = served()
    page = opened(url)
    page.until("!document.querySelector('#record').disabled")
    page.click("#record")
    page.until("document.querySelector('#record').getAttribute('aria-pressed') === 'true'")
    assert (puppet.orders[-1].kind, puppet.orders[-1].value) == (OrderKind.RECORD, 1.0)
    page.click("#record")
    page.until("document.querySelector('#record').getAttribute('aria-pressed') === 'false'")
    assert puppet.orders[-1].value == 0.0


def test_emergency_button_stops(served: Serve, opened: Open) -> None:
    puppet, _, url = served(running())
    page = opened(url)
    page.click("#emergency")
    state(page, "emergency")
    assert [order.kind for order in puppet.orders] == [OrderKind.EMERGENCY]
    page.until("document.querySelector('#banner').innerText.includes('EMERGENCY STOP')")
    words = page.text("#banner")
    assert "pressed by viewer 1 (127.0.0.1) at 0:0" in words and "of run 1" in words
    assert "Reset (Shift+R)" in words and page.value(
        "document.querySelector('#reset').matches('.primary')"
    )
    page.key(" ")
    page.until("document.querySelector('#toasts').innerText.includes('first Reset (Shift+R)')")
    page.click("#reset")
    state(page, "ready")
    page.until("document.querySelector('#banner').innerText.startsWith('Run 2 waits for Start')")
    assert "seed 1 · the robots stay where they stand" in page.text("#banner")
    puppet.give(Order(OrderKind.START, "test"))
    page.until("document.querySelector('#banner').hidden")


def test_escape_stops_even_with_the_help_open_and_a_field_focused(
    served: Serve, opened: Open
) -> None:
    puppet, _, url = served(running())
    page = opened(url)
    page.key("?")
    page.until("document.querySelector('#keys').open")
    page.key("Escape")
    state(page, "emergency")
    puppet.give(Order(OrderKind.RESET, "test"))
    state(page, "ready")
    page.value("document.querySelector('#arena').focus()")
    page.key("Escape")
    state(page, "emergency")


def test_keys_do_what_the_buttons_do(served: Serve, opened: Open) -> None:
    puppet, _, url = served()
    page = opened(url)
    state(page, "ready")
    for key, then in ((" ", "running"), (" ", "paused"), ("S", "ended"), ("R", "ready")):
        page.key(key)
        state(page, then)
    page.key("C")
    page.until("vsense.store.run.recording.on")
    page.key("2")
    page.until("document.querySelector('#main').dataset.view === 'arena'")
    page.key("s")
    page.key("1")
    page.until("document.querySelector('#main').dataset.view === 'both'")
    assert puppet.state == "ready", "a small letter does not stop a run"


def test_an_order_that_cannot_be_is_answered(served: Serve, opened: Open) -> None:
    _, _, url = served(running())
    page = opened(url)
    page.value("vsense.controls.order('start')")
    page.until("document.querySelector('.toast.bad')")
    assert page.text(".toast.bad") == "cannot start: the run is running"


def test_reload_in_mid_run_recovers_everything(served: Serve, opened: Open) -> None:
    puppet, _, url = served(running())
    page = opened(url)
    puppet.say("something happened")
    page.until("document.querySelector('#events').innerText.includes('something happened')")
    page.value("window.old = true")
    page.call("Page.reload")
    page.until("!window.old && vsense.store.experiment && vsense.store.world && vsense.store.run")
    page.until("vsense.arena.drawn.robots.length === 16")
    page.until("document.querySelector('#events').innerText.includes('something happened')")
    page.until("document.querySelector('#robots').tBodies.length === 15")
    page.until("vsense.store.pictures.size === 4")


def test_a_camera_that_is_only_looked_through_gets_all_the_room(
    served: Serve, opened: Open
) -> None:
    _, _, url = served(Puppet(robots=0, cameras=1, mode="track"))
    page = opened(url)
    page.until("document.querySelector('#main').dataset.view === 'cameras'")
    assert "seed" not in page.text("header") or "null" not in page.text("header")
    page.key("1")
    page.until("document.querySelector('#main').dataset.view === 'both'")


def test_a_second_viewer_sees_who_pressed(served: Serve, opened: Open) -> None:
    _, _, url = served(running())
    first, second = opened(url), opened(url)
    first.until("vsense.store.you.viewers === 2")
    second.click("#pause")
    state(first, "paused")
    first.until("document.querySelector('#events').innerText.includes('viewer 2 (127.0.0.1)')")


def test_the_chosen_robot_shows_what_it_senses(served: Serve, opened: Open) -> None:
    puppet, _, url = served(running())
    page = opened(url)
    page.until("vsense.arena.drawn.robots.length === 16")
    tag = puppet.swarm.tags[4]
    page.until(f"vsense.store.rows.has({tag})")
    page.value("vsense.controls.setRefresh(false)")
    page.size(1366, 600)
    # What is frozen takes another shape with its panel.
    frozen = "(() => { const drawing = document.querySelector('#arena');"
    page.until(
        f"{frozen} return drawing.width * drawing.clientHeight ==="
        " drawing.height * drawing.clientWidth; })()"
    )
    x, y = page.value(
        f"{frozen} const r = vsense.arena.drawn.robots.find(r => r.tag === {tag});"
        " const box = drawing.getBoundingClientRect(), scale = box.width / drawing.width;"
        " return [box.x + r.x_px * scale, box.y + r.y_px * scale]; })()"
    )
    page.click_at(x, y)
    page.until(f"vsense.choice.tag === {tag}")
    page.value("vsense.controls.setRefresh(true)")
    page.until("document.querySelector('#readings').rows.length === 4")
    assert page.text("#robot header").startswith(f"Robot {tag}\nepuck_{tag}")
    ages = page.value(
        "[...document.querySelector('#readings').rows].map(r => r.cells[2].innerText)"
    )
    assert ages == ["0 ms", "0 ms", "300 ms", "never"]
    page.key("x")
    page.until("document.querySelector('#robot').hidden")


def test_who_could_move_robots_unseen_stands_in_the_banner(served: Serve, opened: Open) -> None:
    puppet, _, url = served()
    puppet.doubts = ["port 4041 on 0.0.0.0: whoever writes lines moves every robot"]
    page = opened(url)
    page.until("document.querySelector('#banner').innerText.includes('port 4041 on 0.0.0.0')")
    assert "Not authenticated" in page.text("#banner")
    page.click("#start")
    page.until("document.body.dataset.state === 'running'")
    assert "Not authenticated" in page.text("#banner"), "as long as they are open"


def test_trouble_stands_in_the_banner_and_first_in_the_table(served: Serve, opened: Open) -> None:
    puppet, _, url = served(running())
    page = opened(url)
    page.until("document.querySelector('#banner').hidden")
    tag, seen = puppet.swarm.tags[9], f"{len(puppet.swarm.tags)} robots seen"
    # Objects with a marker are seen, too.
    page.until(f"document.querySelector('#arena_note').innerText.startsWith('{seen}')")
    puppet.trouble = {tag: "link lost for 3.2 s"}
    page.until(f"document.querySelector('#banner').innerText.includes('Robot {tag}: link lost')")
    page.until(f"document.querySelector('#robots tbody').innerText.startsWith('{tag}')")
    puppet.trouble = {}
    page.until("document.querySelector('#banner').hidden")
    puppet.held = {tag: "not seen"}
    row = f"[...document.querySelectorAll('#robots tr')].find((r) => r.innerText.includes('{tag}'))"
    page.until(f"{row}.innerText.includes('stands')")
    puppet.held = {}
    page.until(f"{row}.innerText.includes('run')")


def test_a_robot_that_the_runs_machine_drives_says_so(served: Serve, opened: Open) -> None:
    puppet = running()
    tag = puppet.swarm.tags[0]
    _, _, url = served(puppet)
    page = opened(url)
    page.until("vsense.arena.drawn.robots.length === 16")
    here = f"vsense.store.experiment.robots.find(({{ tag }}) => tag === {tag}).driven_here"
    facts = "document.querySelector('#robot_facts').innerText"
    page.value(f"vsense.choice.choose({tag})")
    page.until(f"{facts}.includes('battery')")
    assert not page.value(f"{facts}.includes('driven from')")
    page.value(f"{here} = true")
    page.until(
        f"{facts}.includes('driven from') && {facts}.includes('only the robot stops itself')"
    )


def test_the_fence_is_drawn_where_it_is(served: Serve, opened: Open) -> None:
    puppet = running()
    tag = puppet.swarm.tags[0]
    puppet.fence = {
        "boundary": [(-1.3, -1.0), (1.3, -1.0), (1.3, 1.0), (-1.3, 1.0)],
        "forbidden": [[(0.9, 0.7), (1.2, 0.7), (1.2, 0.9)]],
        "keep_off": [{"tag": tag, "distance_m": 0.3}],
    }
    _, _, url = served(puppet)
    page = opened(url)
    page.until("vsense.arena.drawn.robots.length === 16")
    reds = """((x, y) => {
      const { view, canvas } = vsense.arena;
      const [left, top] = view.spot([x, y, 0]).map(Math.round);
      const pixels = canvas.getContext("2d").getImageData(left - 2, top - 2, 5, 5).data;
      return pixels.filter((red, at) => at % 4 === 0 && red > pixels[at + 1] + 60).length;
    })"""
    for x, y in [(-1.3, 0.13), (0.07, 1.0), (1.2, 0.8)]:
        assert page.value(f"{reds}({x}, {y})") >= 5, (x, y)
    assert page.value(f"{reds}(-1.36, 0.13)") == 0
    around = f"""(({{x_m, y_m}}) => [...Array(12).keys()].map(angle =>
      {reds}(x_m + 0.3 * Math.cos(angle), y_m + 0.3 * Math.sin(angle)))
    )(vsense.arena.drawn.robots.find(robot => robot.tag === {tag}))"""
    assert max(page.value(around)) >= 5


def test_a_camera_that_is_lost_is_shown(served: Serve, opened: Open) -> None:
    puppet, _, url = served(running())
    page = opened(url)
    puppet.camera_trouble = {1: ("lost", "no picture for 12 s")}
    page.until("document.querySelector('#banner').innerText.includes('Camera cam1 is lost')")
    page.until("document.querySelector('.cell.bad strong').innerText.includes('no picture')")


def test_whatever_comes_first_and_whatever_is_missing_no_panel_fails(
    served: Serve, opened: Open
) -> None:
    """Messages in any order, and one whose columns are all empty."""
    puppet, _, url = served(running(), paced=False)
    page = opened(url, "window.vsense?.connection.open")
    page.value("window.failed = []; console.error = error => failed.push(String(error))")
    arena, run = puppet.arena(), puppet.run_message()
    messages = [
        ("/arena", arena), ("/signals", puppet.signals()), ("/robots", puppet.robots()),
        ("/run", run | {"latency_ms": None, "rate_hz": None, "disk_free_bytes": None}),
        ("/arena", arena | {"robots": {name: [] for name in arena["robots"]}}),
        ("/robots", {name: [] for name in puppet.robots()}),
    ]  # fmt: skip
    for topic, data in messages:
        drawn = page.value("vsense.arena.drawn.count")
        puppet.publish(topic, data)
        if topic == "/arena":
            page.until(f"vsense.arena.drawn.count > {drawn}")
    page.until("document.querySelector('#robots_note').innerText.startsWith('0 of 0')")
    page.until("document.querySelector('#tiles').innerText.includes('not measured')")
    assert page.value("failed") == []


def test_pictures_are_shown_and_hidden_ones_are_not_made(served: Serve, opened: Open) -> None:
    puppet, _, url = served(running())
    page = opened(url)
    page.until("vsense.store.pictures.size === 4")
    page.until("[...vsense.cameras.cells.values()].every(cell => cell.shown)")
    assert puppet.bus.wants("/picture/cam0")
    page.key("2")
    page.until("vsense.cameras.shown.length === 0")
    page.until("vsense.connection.frames > 0")
    wait_until_unwanted(page, puppet, "/picture/cam0")
    assert puppet.bus.wants("/arena")


def test_without_refresh_next_to_nothing_is_made(served: Serve, opened: Open) -> None:
    puppet, _, url = served(running())
    page = opened(url)
    page.click("#refresh")
    for topic in ("/arena", "/signals", "/fields", "/picture/cam0"):
        wait_until_unwanted(page, puppet, topic)
    assert puppet.bus.wants("/run") and puppet.bus.wants("/event")
    page.click("#refresh")
    number = page.value("vsense.store.changed.arena")
    page.until(f"vsense.store.changed.arena > {number}")
    # What was missed meanwhile is told again.
    page.until("vsense.store.changed.world >= 2")


def test_a_hidden_page_costs_next_to_nothing(served: Serve, opened: Open) -> None:
    puppet, _, url = served(running())
    page = opened(url)
    hide = "Object.defineProperty(document, 'hidden', { value: %s, configurable: true });"
    told = " document.dispatchEvent(new Event('visibilitychange'))"
    page.value(hide % "true" + told)
    wait_until_unwanted(page, puppet, "/arena")
    page.value(hide % "false" + told)
    number = page.value("vsense.store.changed.arena")
    page.until(f"vsense.store.changed.arena > {number}")


def wait_until_unwanted(page: Page, puppet: Puppet, topic: str) -> None:
    """The page and the server need a moment; each round waits for the page."""
    for _ in range(100):
        if not puppet.bus.wants(topic):
            return
        frames = page.value("vsense.connection.frames")
        page.until(f"vsense.connection.frames > {frames}")
    raise AssertionError(f"{topic} is still wanted")


def test_the_time_line_of_a_replay_seeks(served: Serve, opened: Open) -> None:
    puppet, _, url = served(Puppet(mode="replay"))
    page = opened(url)
    page.until("document.body.dataset.mode === 'replay'")
    assert page.value("document.querySelector('#start').offsetParent") is None
    assert page.value("document.querySelector('#emergency').offsetParent") is None
    page.until("document.querySelector('#seek').max === '90'")
    x, y, width = page.value(
        "(() => { const b = document.querySelector('#seek').getBoundingClientRect();"
        " return [b.x, b.y + b.height / 2, b.width]; })()"
    )
    page.click_at(x + width / 2, y)
    page.until("vsense.store.run.replay.position_s > 40")
    assert {order.kind for order in puppet.orders} == {OrderKind.SEEK}
    assert puppet.position_s == pytest.approx(50.0, abs=2.0), "it begins where the run does"
    page.key("Escape")
    page.click("#play")
    page.until("vsense.store.run.replay.playing")
    page.value("document.querySelector('#play').blur()")
    page.key(" ")
    page.until("!vsense.store.run.replay.playing")
    page.value(
        "(() => { const s = document.querySelector('#speed'); s.value = '4';"
        " s.dispatchEvent(new Event('change')); })()"
    )
    page.until("vsense.store.run.replay.speed === 4")
    assert OrderKind.EMERGENCY not in {order.kind for order in puppet.orders}


def test_a_lost_connection_is_shown_and_comes_back(served: Serve, opened: Open) -> None:
    puppet, server, url = served(running())
    page = opened(url)
    server.close()
    page.until("document.querySelector('#banner').innerText.includes('Connection lost')")
    page.key("Escape")
    page.until("document.querySelector('#banner').innerText.includes('NOT DELIVERED')")
    assert puppet.state == "running"
    again = WebServer(puppet.bus, puppet.give, "127.0.0.1", server.port)
    again.start()
    try:
        state(page, "emergency")
        page.until("vsense.connection.open && vsense.store.experiment")
    finally:
        again.close()


def test_a_dead_network_is_noticed(served: Serve, opened: Open) -> None:
    _, _, url = served(running())
    page = opened(url)
    page.value(
        "(() => { const socket = vsense.connection.socket; socket.onmessage = () => {};"
        " vsense.connection.heard = -1e9; window.dead = socket; })()"
    )
    page.until("vsense.connection.socket !== window.dead && vsense.connection.open")
    page.until("document.querySelector('#banner').hidden")


def test_a_run_that_tells_nothing_is_trouble(served: Serve, opened: Open) -> None:
    puppet, _, url = served(running())
    page = opened(url)
    puppet.silent = True
    page.until("document.querySelector('#banner').innerText.includes('No news from the run')")
    puppet.silent = False
    page.until("document.querySelector('#banner').hidden")


def test_an_emergency_stop_that_nobody_confirms_is_shown(served: Serve, opened: Open) -> None:
    _, _, url = served(running())
    page = opened(url)
    page.value("vsense.connection.socket.send = () => {}")
    page.key("Escape")
    page.until("document.querySelector('#banner').innerText.includes('NOT CONFIRMED')")
    page.value("vsense.connection.socket.onmessage = null; vsense.connection.heard = -1e9")
    state(page, "emergency")
    page.until("!document.querySelector('#banner').innerText.includes('NOT CONFIRMED')")


def test_an_emergency_stop_is_not_stuck_in_a_connection_that_nobody_answers(
    served: Serve, opened: Open
) -> None:
    puppet, server, url = served(running())
    page = opened(url)
    server.close()
    with socket.create_server(("127.0.0.1", server.port)) as silent:
        silent.settimeout(20.0)
        swallowed, _ = silent.accept()
        page.until("vsense.connection.socket.readyState === WebSocket.CONNECTING")
        page.key("Escape")
    # It stays open, as one whose packets a dead network has swallowed, when the network is back.
    with swallowed:
        again = WebServer(puppet.bus, puppet.give, "127.0.0.1", server.port)
        again.start()
        try:
            page.value("window.back = performance.now()")
            state(page, "emergency")
            assert page.value("performance.now() - window.back") < 6000
        finally:
            again.close()


def test_an_emergency_stop_that_is_refused_is_asked_for_until_it_is_taken(
    served: Serve, opened: Open
) -> None:
    puppet, _, url = served(running())
    page = opened(url)
    puppet.refused = "the link has failed"
    page.key("Escape")
    shown = "document.querySelector('#banner').innerText.includes('refused: the link has failed')"
    page.until(shown)
    page.key("C")
    page.until("vsense.store.run.recording.on")
    asked = len(puppet.orders)
    page.until(f"{shown} && vsense.connection.emergency !== null")
    for _ in range(100):
        if len(puppet.orders) > asked + 1:
            break
        time.sleep(0.1)
    assert {order.kind for order in puppet.orders[asked:]} == {OrderKind.EMERGENCY}
    puppet.refused = ""
    state(page, "emergency")
    page.until("!document.querySelector('#banner').innerText.includes('NOT CONFIRMED')")
    taken = len(puppet.orders)
    time.sleep(1.5)
    assert len(puppet.orders) == taken


def test_a_looker_has_no_buttons_and_learns_why(served: Serve, opened: Open) -> None:
    puppet, _, url = served(running(), TOKENS)
    page = opened(url.replace(TOKENS.control, TOKENS.look))
    page.until("document.body.dataset.rights === 'look'")
    assert page.value("location.search") == "", "the token leaves the address"
    assert page.value("document.cookie") == "", "scripts cannot read the cookie"
    assert page.value("document.querySelector('#start').offsetParent") is None
    page.key("Escape")
    page.until("document.querySelector('.toast.bad')?.innerText.includes('looking only')")
    assert puppet.orders == []
    page.call("Page.reload")
    page.until("document.body.dataset.rights === 'look' && vsense.store.arena")


def test_a_wrong_token_is_told_clearly(served: Serve, browser: Browser) -> None:
    _, _, url = served(running(), TOKENS)
    page = browser.open(url.replace(TOKENS.control, "guessed"))
    page.until("document.querySelector('h1')?.innerText === 'This token is not the right one.'")
    page.until("document.readyState === 'complete'")
    page.value("document.querySelector('#token').value = 'to-control-it'")
    page.click("button")
    page.until("window.vsense?.store.you.control && vsense.store.arena")
    page.close()


def test_a_page_from_elsewhere_gets_nothing(served: Serve, browser: Browser) -> None:
    _, server, _ = served(running())
    _, _, url = served(Puppet())
    page = browser.open(url)
    page.until("window.vsense?.store.arena")
    said = page.value(
        "new Promise(done => {"
        f" const socket = new WebSocket('ws://127.0.0.1:{server.port}/ws');"
        " socket.onopen = () => done('open'); socket.onerror = () => done('refused'); })"
    )
    assert said == "refused"
    page.close()


def test_nothing_comes_from_elsewhere_and_nothing_is_wrong(served: Serve, opened: Open) -> None:
    _, _, url = served(running())
    page = opened(url)
    page.until("vsense.store.pictures.size === 4")
    names = page.value("performance.getEntriesByType('resource').map(entry => entry.name)")
    assert names and all(name.startswith((url, "data:")) for name in names)


@pytest.mark.paced
def test_a_hundred_robots_do_not_pile_up(served: Serve, opened: Open) -> None:
    puppet, _, url = served(running(100, 16))
    page = opened(url)
    page.until("vsense.arena.drawn.robots.length === 101")
    page.until("vsense.store.pictures.size === 16")
    behind = []
    for _ in range(10):
        drawn = page.value("vsense.arena.drawn.count")
        page.until(f"vsense.arena.drawn.count > {drawn} + 2")
        behind.append(puppet.total - page.value("vsense.arena.drawn.timestep"))
    # Where drawing is slower than the run a picture is late, and the next one no later: what waited
    # in a line would come later and later.
    assert min(behind[5:]) - min(behind[:5]) <= 5, f"behind by {behind} timesteps"


@pytest.mark.parametrize("dark", [False, True])
def test_light_and_dark(served: Serve, opened: Open, dark: bool) -> None:
    _, _, url = served(running())
    page = opened(url)
    page.dark(dark)
    page.value("localStorage.clear()")
    before = page.value("getComputedStyle(document.body).backgroundColor")
    page.key("t")
    page.until(f"getComputedStyle(document.body).backgroundColor !== '{before}'")
    red = int(before.split("(")[1].split(",")[0])
    assert (red < 80) is dark


def test_every_button_and_picture_has_a_name(served: Serve, opened: Open) -> None:
    _, _, url = served(running())
    page = opened(url)
    page.until("vsense.store.pictures.size === 4")
    nameless = page.value(
        "[...document.querySelectorAll('button, canvas[role], input, select')].filter(e =>"
        " !(e.innerText?.trim() || e.textContent.trim() || e.ariaLabel || e.labels?.length))"
        ".map(e => e.outerHTML)"
    )
    assert nameless == []
