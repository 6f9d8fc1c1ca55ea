"""What the web tests share: a puppet that is served, and one browser for all of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from tests.conftest import require_tool
from tests.monitor.ui.browser import Browser, Page
from tests.monitor.ui.puppet import Puppet
from vsense.monitor.ui._server import WebServer
from vsense.monitor.ui.access import Tokens

Serve = Callable[..., tuple[Puppet, WebServer, str]]
Open = Callable[..., Page]


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """A headless Chromium."""
    opened = Browser(require_tool("chromium", "chromium"))
    yield opened
    opened.close()


@pytest.fixture
def served() -> Iterator[Serve]:
    """Serves puppets on this machine: gives puppet, server and the address that may control."""
    ends: list[Callable[[], None]] = []

    def make(
        puppet: Puppet | None = None, tokens: Tokens | None = None, paced: bool = True
    ) -> tuple[Puppet, WebServer, str]:
        puppet = puppet or Puppet()
        server = WebServer(puppet.bus, puppet.give, "127.0.0.1", 0, tokens, ask=puppet.ask)
        url = server.start().control
        ends.extend((puppet.end, server.close))
        if paced:
            puppet.begin()
        return puppet, server, url

    yield make
    for end in reversed(ends):
        end()


@pytest.fixture
def opened(browser: Browser) -> Iterator[Open]:
    """Opens pages that have got their first arena state."""
    pages: list[Page] = []

    def make(url: str, ready: str = "window.vsense?.store.arena && vsense.store.run") -> Page:
        page = browser.open(url)
        pages.append(page)
        page.until(ready)
        return page

    yield make
    for page in pages:
        page.close()
