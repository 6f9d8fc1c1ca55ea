"""A real lab and its page, waited for and pressed as a person does.

As a program it takes the README's picture: python -m tests.monitor.ui.portrait PNG
or pictures of every state of the page: python -m tests.monitor.ui.portrait states FOLDER
"""

from __future__ import annotations

import re
import signal
import sys
import tempfile
from pathlib import Path

from tests.monitor.ui.browser import Browser, Page
from tests.monitor.ui.puppet import Puppet
from tests.rigs.processes import Lab, Program
from vsense.base.clock import host_ns
from vsense.monitor.ui._server import WebServer

PLACES = "JSON.stringify(vsense.arena.drawn.robots.map(r => [r.x_px, r.y_px]))"
MOMENT = 180
"""Timestep of the run at which the picture is taken: some robots have found the cone."""
SIZE_PX = (1366, 768)
LARGE_PX = (1600, 1000)
SPARE = 37
"""Tag of the robot that plays nobody's part yet."""


class HeldLab(Lab):
    """A lab with a page that waits for a start."""

    def __init__(self, directory: Path) -> None:
        roster = directory.parent / "robots.toml"
        roster.write_text(f"[[robot]]\ntag = {SPARE}\nspare = true\n")
        words = ["--port", "0", "--web", "0", "--hold", "--record", "--roster", str(roster)]
        super().__init__(directory, "pollutant", *words)

    def url(self) -> str:
        """The page's address, once it is told."""
        return self.wait_for(r"control room: http://\S+").split()[-1]

    def close(self) -> None:
        """Kills what is left."""
        self.process.kill()
        self.end()


def state(page: Page, wanted: str) -> None:
    """Waits until the page shows a state."""
    page.until(f"document.body.dataset.state === '{wanted}'")


def press(page: Page, button: str, then: str) -> int:
    """Presses a button and waits for the state that follows; gives when it was pressed."""
    page.until(f"!document.querySelector('#{button}').disabled")
    now_ns = host_ns()
    page.click(f"#{button}")
    state(page, then)
    return now_ns


def picture(page: Page, folder: Path, name: str, size_px: tuple[int, int] = LARGE_PX) -> None:
    """Keeps what the page shows in a window of this size, once it has drawn."""
    page.size(*size_px)
    page.until(f"innerWidth === {size_px[0]}")
    page.value("new Promise(done => setTimeout(done, 1200))")
    page.screenshot(folder / f"{name}.png")
    print(folder / f"{name}.png", flush=True)


def lab_states(browser: Browser, folder: Path, lab: HeldLab) -> None:
    """Idle, running, dark, phone, paused, emergency, and what comes after a reset."""
    page = browser.open(lab.url(), *LARGE_PX)
    page.until("window.vsense?.store.arena && vsense.store.run")
    state(page, "ready")
    picture(page, folder, "idle")
    press(page, "start", "running")
    page.until("vsense.store.arena.run_timestep >= 60")
    picture(page, folder, "running")
    page.key("j")
    page.dark(True)
    picture(page, folder, "dark")
    page.dark(False)
    picture(page, folder, "tablet", (800, 1000))
    picture(page, folder, "phone", (390, 844))
    page.size(*LARGE_PX)
    press(page, "pause", "paused")
    picture(page, folder, "paused")
    press(page, "start", "running")
    screen = browser.open(lab.url() + "screen", *LARGE_PX)
    screen.until("window.vsense?.store.arena && vsense.store.run")
    picture(screen, folder, "screen")
    page.key("Escape")
    state(page, "emergency")
    page.key(" ")
    picture(page, folder, "emergency")
    press(page, "reset", "ready")
    picture(page, folder, "after-a-reset")
    press(page, "start", "running")
    page.until("vsense.store.arena.run_timestep >= 10")
    press(page, "stop", "ended")
    picture(page, folder, "ended")


def program_states(browser: Browser, folder: Path, work: Path, recording: Path) -> None:
    """A replay, the tracker alone, and a simulation at 100 times real time, opened at its end."""
    vsense = [sys.executable, "-m", "vsense"]
    address = r"http://127\.0\.0\.1:\d+/"

    def watched(name: str, *words: str) -> None:
        program = Program([*vsense, *words, "--web", "0"], cwd=work)
        try:
            found = re.search(address, program.wait_for(address))
            assert found
            page = browser.open(found[0], *LARGE_PX)
            page.until("window.vsense?.store.arena && vsense.store.run")
            if words[0] == "sim":
                page.value("vsense.controls.order('speed', 100), vsense.controls.order('start')")
                page.until("vsense.store.now.time_s > 95 || vsense.store.run.state === 'ended'")
                page.go(found[0])
                page.until("window.vsense?.store.arena && vsense.store.run.state === 'ended'")
            picture(page, folder, name)
            page.close()
        finally:
            program.process.terminate()
            program.end()

    watched("replay", "replay", str(recording))
    watched("sim-at-100x", "sim", "foraging", "--hold", "--duration", "120", "-o", "sim")


def track_state(browser: Browser, folder: Path) -> None:
    """The tracker alone, of messages that are made up: it needs cameras."""
    puppet = Puppet(mode="track")
    server = WebServer(puppet.bus, puppet.give, "127.0.0.1", 0)
    puppet.begin()
    try:
        page = browser.open(server.start().control, *LARGE_PX)
        page.until("window.vsense?.store.arena && vsense.store.run")
        picture(page, folder, "track")
    finally:
        server.close()
        puppet.end()


def all_states(folder: Path) -> None:
    """Keeps pictures of every state of the page, for people to look at."""
    folder.mkdir(parents=True, exist_ok=True)
    browser = Browser("chromium")
    with tempfile.TemporaryDirectory() as work:
        lab = HeldLab(Path(work) / "run")
        try:
            lab_states(browser, folder, lab)
            lab.process.send_signal(signal.SIGINT)
            lab.end()
            program_states(browser, folder, Path(work), Path(work) / "run" / "run-1")
            track_state(browser, folder)
        finally:
            lab.close()
            browser.close()


def main() -> None:
    """Keeps the README's picture of a lab, as a visitor sees it, or those of all states."""
    if len(sys.argv) > 2:
        all_states(Path(sys.argv[2]))
        return
    browser = Browser("chromium")
    with tempfile.TemporaryDirectory() as folder:
        lab = HeldLab(Path(folder) / "run")
        try:
            page = browser.open(lab.url(), *SIZE_PX)
            page.until("window.vsense?.store.arena && vsense.store.run")
            state(page, "ready")
            press(page, "start", "running")
            page.until("vsense.store.arena.run_timestep >= 5")
            page.key("j")
            page.until(f"vsense.store.arena.run_timestep >= {MOMENT}")
            page.screenshot(Path(sys.argv[1]))
        finally:
            lab.close()
            browser.close()


if __name__ == "__main__":
    main()
