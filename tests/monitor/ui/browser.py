"""A headless Chromium, driven through its DevTools protocol as a person drives it."""

from __future__ import annotations

import asyncio
import base64
import collections
import contextlib
import itertools
import json
import shutil
import subprocess
import tempfile
import threading
from pathlib import Path
from typing import Any

import aiohttp

FLAGS = (
    "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
    "--disable-dev-shm-usage", "--hide-scrollbars", "--remote-debugging-port=0",
)  # fmt: skip
PATIENCE_S = 60.0
KEYS = {" ": "Space", "Escape": "Escape"}


class BrowserError(Exception):
    """The browser did not do what it was told; a page that is just leaving cannot."""


class Browser:
    """The program; `open` gives pages."""

    def __init__(self, program: str) -> None:
        self.loop = asyncio.new_event_loop()
        self._folder = tempfile.mkdtemp(prefix="vsense-browser-")
        # It ends with whoever started it, even if that one is killed.
        follow = ["setpriv", "--pdeathsig", "TERM"] if shutil.which("setpriv") else []
        self._process = subprocess.Popen(
            [*follow, program, *FLAGS, f"--user-data-dir={self._folder}", "about:blank"],
            stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        assert self._process.stderr is not None
        lines = (line for line in self._process.stderr if "DevTools listening on" in line)
        self._url = next(lines).split()[-1]
        # Whatever else it says is read and dropped: it would stand still before a full pipe.
        threading.Thread(target=collections.deque, args=(lines, 0), daemon=True).start()
        self._numbers = itertools.count(1)
        self._wait(self._connect())

    def _wait(self, what: Any) -> Any:
        return self.loop.run_until_complete(asyncio.wait_for(what, PATIENCE_S))

    async def _connect(self) -> None:
        self._session = aiohttp.ClientSession()
        self._socket = await self._session.ws_connect(self._url, max_msg_size=0)

    def call(self, method: str, session: str | None = None, **parameters: Any) -> Any:
        """Calls one method and waits for its result; what happens meanwhile is not looked at."""
        return self._wait(self._call(method, session, parameters))

    async def _call(self, method: str, session: str | None, parameters: dict[str, Any]) -> Any:
        number = next(self._numbers)
        sentence = {"id": number, "method": method, "params": parameters}
        await self._socket.send_json(sentence | ({"sessionId": session} if session else {}))
        while True:
            answer = json.loads(await self._socket.receive_str())
            if answer.get("id") == number:
                if "error" in answer:
                    raise BrowserError(f"{method}: {answer['error']['message']}")
                return answer["result"]

    def open(self, url: str, width: int = 1366, height: int = 768) -> Page:
        """Opens a page in a window of its own, with cookies of its own."""
        context = self.call("Target.createBrowserContext")["browserContextId"]
        target = self.call("Target.createTarget", url="about:blank", browserContextId=context)
        attached = self.call("Target.attachToTarget", targetId=target["targetId"], flatten=True)
        page = Page(self, attached["sessionId"], target["targetId"])
        # Keys reach a page whose window has no focus only now and then.
        page.call("Emulation.setFocusEmulationEnabled", enabled=True)
        page.size(width, height)
        page.go(url)
        return page

    def close(self) -> None:
        """Ends it."""
        self._process.terminate()
        self._process.wait()
        self._wait(self._session.close())
        self.loop.close()
        # Its children write a last word after it.
        for _ in range(100):
            shutil.rmtree(self._folder, ignore_errors=True)
            if not Path(self._folder).exists():
                return


class Page:
    """One page."""

    def __init__(self, browser: Browser, session: str, target: str) -> None:
        self._browser = browser
        self._session = session
        self._target = target

    def call(self, method: str, **parameters: Any) -> Any:
        """Calls a DevTools method of this page."""
        return self._browser.call(method, self._session, **parameters)

    def size(self, width: int, height: int) -> None:
        """Gives the window another size."""
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height,
                  deviceScaleFactor=1, mobile=False)  # fmt: skip

    def go(self, url: str) -> None:
        """Goes to an address."""
        self.call("Page.navigate", url=url)

    def dark(self, on: bool) -> None:
        """Sets what the system prefers."""
        scheme = {"name": "prefers-color-scheme", "value": "dark" if on else "light"}
        self.call("Emulation.setEmulatedMedia", features=[scheme])

    def value(self, expression: str) -> Any:
        """Evaluates JavaScript; promises are waited for."""
        made = self.call(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in made, made["exceptionDetails"]
        return made["result"].get("value")

    def until(self, expression: str) -> Any:
        """Waits until JavaScript gives something true, and gives that."""
        for _ in range(300):
            # A page that is just being loaded has no answers yet.
            with contextlib.suppress(BrowserError):
                found = self.value(
                    "new Promise(done => { const end = performance.now() + 200;"
                    " const look = () => {"
                    f" let found; try {{ found = {expression}; }} catch {{ found = null; }}"
                    " if (found || performance.now() > end) done(found instanceof Node || found);"
                    " else setTimeout(look, 10); }; look(); })"
                )
                if found:
                    return found
        raise AssertionError(f"never true: {expression}")

    def text(self, selector: str) -> str:
        """What an element says, as it is shown."""
        return str(self.value(f"document.querySelector({selector!r}).innerText"))

    def key(self, key: str) -> None:
        """Presses a key."""
        about: dict[str, Any] = {"key": key, "code": KEYS.get(key, f"Key{key.upper()}")}
        if len(key) == 1:
            about |= {"text": key, "modifiers": 8 if key.isupper() else 0}
        self.call("Input.dispatchKeyEvent", type="keyDown", **about)
        self.call("Input.dispatchKeyEvent", type="keyUp", **about)

    def click(self, selector: str) -> None:
        """Clicks into the middle of an element, once it takes clicks."""
        self.until(f"!document.querySelector({selector!r}).disabled")
        x, y = self.value(
            f"(() => {{ const box = document.querySelector({selector!r}).getBoundingClientRect();"
            " return [box.x + box.width / 2, box.y + box.height / 2]; })()"
        )
        self.click_at(x, y)

    def click_at(self, x: float, y: float) -> None:
        """Clicks at a place of the window."""
        for kind in ("mousePressed", "mouseReleased"):
            self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)

    def drag(self, begin: tuple[float, float], end: tuple[float, float]) -> None:
        """Drags with the mouse from one place of the window to another."""
        places = [begin, *(_between(begin, end, share / 4) for share in range(1, 5)), end]
        kinds = ["mousePressed", *["mouseMoved"] * 4, "mouseReleased"]
        for kind, (x, y) in zip(kinds, places, strict=True):
            self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1,
                      clickCount=1)  # fmt: skip

    def screenshot(self, path: Path) -> None:
        """Takes a picture of the window."""
        taken = self.call("Page.captureScreenshot", format="png")
        path.write_bytes(base64.b64decode(taken["data"]))

    def close(self) -> None:
        """Closes the page."""
        self._browser.call("Target.closeTarget", targetId=self._target)


def _between(
    begin: tuple[float, float], end: tuple[float, float], share: float
) -> tuple[float, float]:
    return begin[0] + share * (end[0] - begin[0]), begin[1] + share * (end[1] - begin[1])
