"""A real lab and its page, waited for and pressed as a person does.

As a program it takes the README's picture: python -m tests.monitor.ui.portrait PNG
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from tests.monitor.ui.browser import Browser, Page
from tests.rigs.processes import Lab
from vsense.base.clock import host_ns

PLACES = "JSON.stringify(vsense.arena.drawn.robots.map(r => [r.x_px, r.y_px]))"
MOMENT = 180
"""Timestep of the run at which the picture is taken: some robots have found the cone."""
SIZE_PX = (1366, 768)
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


def main() -> None:
    """Runs the lab, looks at its page as a visitor would, and keeps the picture."""
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
