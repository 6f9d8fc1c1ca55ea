"""The network between trackers and the nodes of their cameras: Eclipse Zenoh.

Zenoh carries the bytes, connects again, lets in and encrypts; its own configuration says how. The
tracker listens, nodes connect to it or both to a router. Nobody is searched for on the network, and
a node listens on no port.

Keys are `vsense/ARENA/NODE/PART`. A node answers `open`, `read` and `detect`, and hears `expect`;
it says `rows`, `events` and `preview`.
"""

from __future__ import annotations

import json
import queue
import re
import resource
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vsense.base import errors
from vsense.base.errors import UsageError, VsenseError
from vsense.base.files import read_bytes
from vsense.base.terminal import printable

OPEN_S = 10.0
"""A session that takes longer is not to be had: Zenoh can wait for memory for ever."""
NEEDED_BYTES = 640 << 20
"""Of addresses: Zenoh's threads reserve them, and use a fortieth part."""
LEASE_MS = 1000
"""A connection that is silent for so long is over, and made again."""
OPENING_MS, RETRY_MS, ROUTER_MS = 750, 100, 5000
"""An attempt to connect is given up, and made again: the system's own attempts grow rarer. A
router has to be there within the last."""
MOST_WAITING = 64
"""Questions at a node: more than a tracker has cameras there."""

_ENDPOINT = re.compile(r"(tcp|tls|quic|udp)/(\S+):(\d{1,5})")
NODE_NAME = re.compile(r"[A-Za-z0-9_.-]{1,64}")
"""Names of arenas and nodes: parts of Zenoh's keys."""


def check_endpoint(text: str) -> str:
    """Returns an address such as `tcp/10.0.0.2:7447`; UsageError: it is none."""
    match = _ENDPOINT.fullmatch(text)
    if match is None or not 0 < int(match[3]) < 65536:
        raise UsageError(f"{text!r} is no address of Zenoh's, expected such as tcp/10.0.0.2:7447")
    return text


def require_zenoh() -> None:
    """Raises UsageError unless Zenoh is installed."""
    errors.require("cameras on several computers need", "zenoh")


def node_key(arena: str, node: str, part: str) -> str:
    """The key of a part of what a node has."""
    return f"vsense/{arena}/{node}/{part}"


class NodeRefusal(VsenseError):
    """What a node says where it does not do what it is asked for."""


@dataclass(frozen=True, slots=True)
class NodeNetwork:
    """How one reaches the other end.

    Attributes:
        listen, connect: Addresses such as `tcp/0.0.0.0:7447`.
        config: A file of Zenoh's own configuration, for certificates and access; None: none.
        arena: First part of the keys: trackers of several arenas can share a router.
    """

    listen: tuple[str, ...] = ()
    connect: tuple[str, ...] = ()
    config: Path | None = None
    arena: str = "arena"


def open_network(network: NodeNetwork, mode: str = "peer") -> Any:
    """Opens a session of Zenoh's; raises UsageError or VsenseError, which say what is wrong.

    A "peer" listens, or waits for whom it connects to; a "client" has its router, or raises. A
    router passes on what one of either says to the other, and nothing between two peers.
    """
    require_zenoh()
    try:
        import zenoh
    except ImportError as error:
        raise VsenseError(f"Zenoh cannot be loaded: {error}") from None
    config = _config(zenoh, network, mode)
    where = ", ".join((*network.listen, *network.connect))
    if (left := _memory_left()) < NEEDED_BYTES:
        raise VsenseError(
            f"{where}: Zenoh does not begin: the limit of memory (ulimit -v) leaves"
            f" {left >> 20} MB, expected at least {NEEDED_BYTES >> 20} MB"
        )
    answer: list[Any] = []

    def work() -> None:
        try:
            answer.append(zenoh.open(config))
        except BaseException as error:  # a panic of its own is no Exception
            answer.append(error)

    thread = threading.Thread(target=work, name="zenoh", daemon=True)
    try:
        thread.start()
    except RuntimeError as error:
        raise VsenseError(f"{where}: Zenoh does not begin: {error}") from None
    thread.join(OPEN_S)
    if not answer:
        raise VsenseError(f"{where}: Zenoh has not begun in {OPEN_S:g} s: is memory left?")
    if isinstance(answer[0], BaseException):
        raise VsenseError(f"{where}: Zenoh does not begin: {_reason(answer[0])}")
    return answer[0]


def _memory_left() -> int:
    """Bytes that this process may add; where memory ends meanwhile, Zenoh ends the process."""
    most, _ = resource.getrlimit(resource.RLIMIT_AS)
    if most == resource.RLIM_INFINITY:
        return NEEDED_BYTES
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    return max(most - pages * resource.getpagesize(), 0)


def _config(zenoh: Any, network: NodeNetwork, mode: str) -> Any:
    """Returns Zenoh's configuration: the file's, and on top of it what vsense needs."""
    try:
        config = zenoh.Config()
        if network.config is not None:
            read_bytes(network.config)  # Zenoh would wait for ever for a pipe's other end
            config = zenoh.Config.from_file(str(network.config))
    except Exception as error:
        text = f"{network.config}: no configuration of Zenoh's: {_reason(error)}"
        raise UsageError(text) from None
    # Zenoh tries for ever, and does not say that one is missing.
    for name, file in json.loads(config.get_json("transport/link/tls")).items():
        try:
            if name.endswith(("_certificate", "_private_key")) and file is not None:
                read_bytes(Path(file))
        except OSError as error:
            raise UsageError(f"{network.config}: {name}: {file}: {error.strerror}") from None
    settings: dict[str, object] = {
        "mode": mode,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "scouting/delay": 0,
        "transport/link/tx/lease": LEASE_MS,
        "transport/unicast/open_timeout": OPENING_MS,
        "transport/shared_memory/enabled": False,
    }
    for way, addresses in (("listen", network.listen), ("connect", network.connect)):
        settings[f"{way}/endpoints"] = list(addresses)
    if network.connect:
        retry = {"period_init_ms": RETRY_MS, "period_max_ms": RETRY_MS}
        settings["connect/retry"] = {**retry, "period_increase_factor": 1.0}
        timeout_ms = ROUTER_MS if mode == "client" else -1
        settings |= {"connect/timeout_ms": timeout_ms, "connect/exit_on_failure": False}
    try:
        for path, value in settings.items():
            config.insert_json5(path, json.dumps(value))
    except Exception as error:
        raise UsageError(f"{network.config}: cannot be used: {_reason(error)}") from None
    return config


def _reason(error: BaseException) -> str:
    """The first words of what Zenoh says, without where in its sources that was."""
    words = " ".join(re.sub(r"\s*\bat /\S+", "", str(error)).split())
    return words.rstrip(".]") or type(error).__name__


def put(session: Any, key: str, data: bytes, urgent: bool = True) -> None:
    """Says something that is worth nothing when it comes late; never waits.

    Raises:
        VsenseError: The session is closed.
    """
    import zenoh

    priority = zenoh.Priority.REAL_TIME if urgent else zenoh.Priority.BACKGROUND
    drop = zenoh.CongestionControl.DROP
    try:
        session.put(key, data, priority=priority, congestion_control=drop, express=urgent)
    except Exception as error:
        raise VsenseError(f"{key}: {_reason(error)}") from None


def ask(session: Any, key: str, data: bytes, timeout_s: float) -> Any:
    """Begins to ask a node; `answer_of` waits for what it says."""
    import zenoh

    # Otherwise an answer waits until nobody can say more.
    whole = zenoh.ConsolidationMode.NONE
    return session.get(key, payload=data, timeout=timeout_s, consolidation=whole)


def answer_of(replies: Any, node: str) -> bytes:
    """Waits for a node's answer; VsenseError: it has none, or refuses."""
    try:
        for reply in replies:
            if reply.ok is not None:
                return bytes(reply.ok.payload.to_bytes())
            text = reply.err.payload.to_bytes().decode(errors="replace")
            if text == "Timeout":  # Zenoh's own answer
                raise VsenseError(f"node {node} does not answer")
            raise NodeRefusal(f"node {node}: {printable(text[:300])}")
    except VsenseError:
        raise
    except Exception as error:
        raise VsenseError(f"node {node}: {_reason(error)}") from None
    raise VsenseError(f"node {node} is not there: is `vsense camera node` running?")


def hear(session: Any, key: str, take: Callable[[Any], object]) -> Any:
    """Has what is said under a key be taken where it comes, by a thread of Zenoh's.

    What comes too fast waits at its sender: Zenoh's own queue in between has no end.
    """
    import zenoh

    return session.declare_subscriber(key, zenoh.handlers.Callback(take, indirect=False))


def wait_in(questions: queue.Queue[Any], query: Any) -> None:
    """Has a question wait, or refuses it where too many do."""
    try:
        questions.put_nowait(query)
    except queue.Full:
        refuse(query, "is asked too much at once")


def answer_by(
    threads: ThreadPoolExecutor, answer: Callable[[Any], object]
) -> Callable[[Any], None]:
    """Returns what has threads answer questions, of which a few may wait; others are refused."""
    free = threading.BoundedSemaphore(MOST_WAITING)

    def work(query: Any) -> None:
        try:
            answer(query)
        finally:
            free.release()

    def take(query: Any) -> None:
        if free.acquire(blocking=False):
            threads.submit(work, query)
        else:
            refuse(query, "is asked too much at once")

    return take


def is_connected(session: Any) -> bool:
    """Whether the other end, or a router, is there."""
    return bool(session.info.peers_zid() or session.info.routers_zid())


def reply(query: Any, data: bytes) -> None:
    """Answers a question."""
    query.reply(query.key_expr, data)
    query.drop()


def refuse(query: Any, text: str) -> None:
    """Answers a question with what is wrong with it."""
    query.reply_err(text.encode())
    query.drop()
