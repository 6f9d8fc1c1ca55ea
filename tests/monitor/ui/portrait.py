"""Takes the README's picture of the control room: python -m tests.monitor.ui.portrait PNG"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from tests.monitor.ui.browser import Browser
from tests.monitor.ui.test_lab_page import Lab, press
from tests.monitor.ui.test_page import state

MOMENT = 180
"""Timestep of the run at which it is taken: some robots have found the cone."""
SIZE_PX = (1366, 768)


def main() -> None:
    """Runs the lab, looks at its page as a visitor would, and keeps the picture."""
    browser = Browser("chromium")
    with tempfile.TemporaryDirectory() as folder:
        lab = Lab(Path(folder) / "run")
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
