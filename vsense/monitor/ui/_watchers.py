"""The watchers of a process: whatever looks at its runs, made from its options by one table.

A new watcher is a file with a class like `Watcher`, its option in `WatchOptions`, and a row in
`WATCHERS`. Recordings begin and end with runs: `vsense.monitor.ui.recorders`.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from vsense.base import errors
from vsense.base.message_bus import MessageBus
from vsense.base.terminal import Console
from vsense.monitor.ui._certificate import PageTls, tls_of
from vsense.monitor.ui._foxglove_server import FoxgloveServer
from vsense.monitor.ui._ros2_publisher import Ros2Publisher, check_ros2
from vsense.monitor.ui.access import FoxgloveAddress, Tokens, WebAddress, is_loopback, read_tokens
from vsense.run.changes import Ask
from vsense.run.orders import Give

if TYPE_CHECKING:
    from vsense.monitor.recording.reader import Recording
    from vsense.monitor.ui._server import WebServer


@dataclass(frozen=True, slots=True)
class WatchOptions:
    """Who looks at the runs of a process.

    Attributes:
        web: where the page is served, None: nowhere.
        foxglove: where Foxglove is served, None: nowhere.
        tokens: of the page, where its file has none; None: they are drawn.
        ros2: domain of DDS in which ROS 2 hears of it, None: none.
    """

    web: WebAddress | None = None
    foxglove: FoxgloveAddress | None = None
    tokens: Tokens | None = None
    ros2: int | None = None


@dataclass(frozen=True, slots=True)
class WatchedBus:
    """What watchers look at, and what they may do; any thread may call what is in it.

    Attributes:
        bus: carries all messages.
        give: carries orders out.
        console: takes lines for people.
        ask: takes changes of the world; None: there can be none.
        recording: the one that is played; None: time is now.
        title: what the page's address is told with.
    """

    bus: MessageBus
    give: Give
    console: Console
    ask: Ask | None = None
    recording: Recording | None = None
    title: str = "control room"

    def warn(self, text: str) -> None:
        """Takes a line about strangers, or about what no longer works."""
        self.console.say(text, "warning")


class Watcher(Protocol):
    """Looks at what a bus carries, in threads or processes of its own.

    It joins the bus with a function that takes messages and does not wait (`MessageBus.join`).
    """

    def start(self) -> object:
        """Begins, and says where on the console; VsenseError: it cannot."""

    def close(self) -> None:
        """Ends."""


MakeWatcher = Callable[[WatchedBus], Watcher]


@dataclass(frozen=True, slots=True)
class PageAccess:
    """A page's address, and what its files hold: who may come in, and how it is encrypted.

    Attributes:
        web: where it is served.
        tokens: of the file; None: the server draws them.
        tls: None for plain HTTP.
    """

    web: WebAddress
    tokens: Tokens | None
    tls: PageTls | None

    def warnings(self) -> list[str]:
        """What people should know of how the page is encrypted."""
        if self.tls is None and not is_loopback(self.web.host):
            return [
                "not encrypted: the page's tokens go over plain HTTP; one that is heard can be used"
            ]
        if self.tls is None or not self.tls.fingerprint:
            return []
        return [
            "the page's certificate was made here: browsers warn; accept it once, where its SHA-256"
            f" fingerprint is {self.tls.fingerprint}"
        ]


def page_access(web: WebAddress, tokens: Tokens | None = None) -> PageAccess:
    """Reads what a page needs, before anything is started; `tokens` are for a file without.

    Raises:
        VsenseError: a library for the page is missing, or the files for it cannot be used.
    """
    errors.require("the page needs", "aiohttp")
    return PageAccess(web, tokens if web.tokens is None else read_tokens(web.tokens), tls_of(web))


class WebWatcher:
    """Serves the page; `server` is made, and serves from `start` on."""

    def __init__(self, access: PageAccess, runs: WatchedBus) -> None:
        from vsense.monitor.ui._server import WebServer

        self._access, self._runs = access, runs
        web, tls = access.web, access.tls
        self.server: WebServer = WebServer(
            runs.bus,
            runs.give,
            web.host,
            web.port,
            access.tokens,
            runs.warn,
            None if tls is None else tls.context,
            runs.ask,
        )

    def start(self) -> None:
        """See `Watcher.start`; VsenseError if the port is taken."""
        addresses, title = self.server.start(), self._runs.title
        lines = [f"{title}: {addresses.control}"]
        if addresses.look != addresses.control:
            lines.append(f"{title}, to look only: {addresses.look}")
        for line in [*lines, *self._access.warnings()]:
            # With its tokens: neither the pages nor the log may have them.
            self._runs.console.print_only(line)

    def close(self) -> None:
        """See `Watcher.close`."""
        self.server.close()


def _page(options: WatchOptions) -> MakeWatcher | None:
    if options.web is None:
        return None
    access = page_access(options.web, options.tokens)
    return lambda runs: WebWatcher(access, runs)


def _foxglove(options: WatchOptions) -> MakeWatcher | None:
    address = options.foxglove
    if address is None:
        return None

    def make(runs: WatchedBus) -> Watcher:
        give = None if runs.recording is None else runs.give
        return FoxgloveServer(runs.bus, address, runs.console, runs.recording, give)

    return make


def _ros2(options: WatchOptions) -> MakeWatcher | None:
    domain = options.ros2
    if domain is None:
        return None
    check_ros2(domain)

    def make(runs: WatchedBus) -> Watcher:
        recording = runs.recording
        shift_ns = None if recording is None else recording.utc_shift_ns
        return Ros2Publisher(runs.bus, domain, runs.console, shift_ns)

    return make


WATCHERS: tuple[Callable[[WatchOptions], MakeWatcher | None], ...] = (_page, _foxglove, _ros2)
"""Each reads of the options what it needs, and raises VsenseError where it cannot be used; None: it
is not asked for."""


def wanted_watchers(options: WatchOptions) -> list[MakeWatcher]:
    """Those that are asked for, before anything is started.

    Raises:
        VsenseError: a library is missing, or a file cannot be used.
    """
    return [make for row in WATCHERS if (make := row(options)) is not None]


def start_watchers(stack: ExitStack, makers: list[MakeWatcher], runs: WatchedBus) -> None:
    """Starts watchers, which end with `stack`.

    Raises:
        VsenseError: one cannot start: its port is taken.
    """
    for make in makers:
        watcher = make(runs)
        watcher.start()
        stack.callback(watcher.close)
