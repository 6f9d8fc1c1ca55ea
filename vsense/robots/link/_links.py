"""All TCP connections of a server, from accepting to closing.

Everything that concerns one robot affects that robot alone: a full stream keeps its newest STATE,
a broken one is closed, bytes that no robot sends end the connection that they came from. So does a
bug of ours (`contain`). Only the server's thread calls this, but for `put_state` and `dirty`.
"""

from __future__ import annotations

import selectors
import socket
from collections.abc import Callable
from functools import partial

from vsense.base.native import WireError, lib
from vsense.robots.link import strangers
from vsense.robots.link._session import Address, HostSession, PendingSession
from vsense.robots.link._shared import ServerState
from vsense.robots.link._streams import Connection
from vsense.robots.link.status import LinkEvent
from vsense.robots.link.strangers import PortPlaces, owner_of
from vsense.robots.link.wire import GoodbyeCause, Notice, PacketType, RefuseCode, decode_body

HELLO_NS = 2_000_000_000
"""A connection that has not greeted after this long, or then not shown its key, is closed."""

FINISH_NS = 500_000_000
"""How long a peer may take to read our last packet and to close its side."""

LOST_STREAM_CODES = frozenset(
    {
        *(lib.VS_ERR_TAG, lib.VS_ERR_MAGIC, lib.VS_ERR_VERSION, lib.VS_ERR_LENGTH),
        *(lib.VS_ERR_TYPE, lib.VS_ERR_SHORT),
    }
)
"""Why a packet was dropped that no robot sends: the stream is lost."""

UNGREETED_MAX, UNGREETED_EACH = 64, 32
"""Connections that have not greeted, in all and from one address; the oldest makes way for one
more. Robots greet at once: a hundred behind one relay need few of these places at a time."""

GREETED_MAX, GREETED_EACH = 64, 32
"""Likewise those that have greeted and have yet to prove their key, beside one for every robot;
`GREETED_EACH` in the name of one robot."""

ACCEPTED_MAX = 8
"""Connections that are accepted in a row: then those that are open are heard, and few wait."""

DEAF_TEXT = "its packets do not follow what came in its name before: its session is renewed"

READ, WRITE = selectors.EVENT_READ, selectors.EVENT_WRITE


class Connections:
    """The TCP side of a server.

    Args:
        listener: the listening socket.
        selector: calls what is registered with it with the ready events.
        offered: called under the lock when a session was offered to a robot; gives the STATE that
            follows the WELCOME, b"": none.
        opened: called under the lock when a robot's session has opened.

    Attributes:
        dirty: connections that another thread has left unfinished or found broken.
    """

    def __init__(
        self,
        shared: ServerState,
        listener: socket.socket,
        selector: selectors.BaseSelector,
        offered: Callable[[PendingSession], bytes],
        opened: Callable[[], None],
    ) -> None:
        self.dirty: set[Connection] = set()
        self._shared = shared
        self._listener = listener
        self._selector = selector
        self._offered, self._opened = offered, opened
        self._all: dict[socket.socket, Connection] = {}
        self._by_tag: dict[int, Connection] = {}
        self._strangers = PortPlaces[Connection](strangers.places(UNGREETED_MAX), UNGREETED_EACH)
        most = strangers.places(GREETED_MAX) + len(shared.roster.robots)
        self._greeted = PortPlaces[Connection](most, GREETED_EACH)
        self._listening = False
        self._finishing = False
        self._listen()

    def __len__(self) -> int:
        return len(self._all)

    def put_state(self, robot: HostSession, packet: bytes) -> None:
        """Sends a STATE over TCP as far as the stream takes it; any thread, under the lock."""
        connection = self._by_tag[robot.tag]
        robot.superseded += connection.outbox.put_state(packet)
        connection.write()
        if connection.outbox or connection.broken:
            self.dirty.add(connection)

    def settle(self) -> None:
        """Continues with the connections in `dirty`."""
        with self._shared.lock:
            dirty, self.dirty = self.dirty, set()
        for connection in dirty:
            self._watch(connection)

    def keep_time(self, now_ns: int) -> None:
        """Closes connections past their deadline, and listens again after a pause."""
        for connection in list(self._all.values()):
            if (robot := connection.robot) is not None:
                if robot.outworn:
                    self.dismiss(robot, GoodbyeCause.RENEW, robot.outworn)
                elif robot.deaf:
                    text = f"{robot.label}: {DEAF_TEXT}"
                    self.dismiss(robot, GoodbyeCause.RENEW, DEAF_TEXT)
                    self._shared.notify(LinkEvent("doubt", robot.tag, text, now_ns))
            elif connection.deadline_ns <= now_ns:
                if not connection.finishing:
                    what = "show that it is a robot" if connection.pending else "greet"
                    self._report(connection, f"connected, but did not {what} within 2 s")
                self._drop(connection)
        self._listen()

    def finish(self, cause: GoodbyeCause, text: str) -> None:
        """Accepts no more connections and says goodbye to all robots."""
        self._finishing = True
        self._pause()
        for connection in list(self._all.values()):
            if connection.robot is not None:
                self.dismiss(connection.robot, cause, text)
            elif not connection.finishing:
                self._drop(connection)

    def close(self) -> None:
        self._pause()
        for connection in list(self._all.values()):
            self._drop(connection)

    # --- who comes

    def _listen(self) -> None:
        if not self._listening and not self._finishing:
            self._selector.register(self._listener, READ, self._accept)
            self._listening = True

    def _pause(self) -> None:
        if self._listening:
            self._selector.unregister(self._listener)
            self._listening = False

    def _accept(self, _mask: int) -> None:
        now_ns = self._shared.clock()
        try:
            for _ in range(ACCEPTED_MAX):
                self._welcome(*self._listener.accept(), now_ns)
        except (BlockingIOError, InterruptedError, ConnectionError):
            return
        except OSError as error:
            # Out of descriptors: the listener would be ready for ever; try again a little later.
            self._pause()
            text = f"cannot accept a connection: {error.strerror}"
            self._shared.notify(LinkEvent("protocol_error", None, text, now_ns))

    def _welcome(self, sock: socket.socket, address: tuple[object, ...], now_ns: int) -> None:
        connection = Connection(sock, str(address[0]), now_ns + HELLO_NS)
        self._make_way(self._strangers.add(connection, owner_of(connection.origin)))
        self._all[sock] = connection
        self._selector.register(sock, READ, partial(self._serve, connection))

    def _make_way(self, loser: Connection | None) -> None:
        """Closes the connection that has lost its place to another, if one has."""
        if loser is not None:
            if not loser.finishing:
                whose = f" in the name of {loser.pending.robot.label}" if loser.pending else ""
                self._report(loser, f"too many connections at once{whose}")
            self._drop(loser)

    def _report(self, stranger: Connection, text: str) -> None:
        origin, now_ns = stranger.origin, self._shared.clock()
        event = LinkEvent("protocol_error", None, f"{origin}: {text}", now_ns, origin)
        self._shared.notify(event)

    # --- who talks

    def _serve(self, connection: Connection, mask: int) -> None:
        if connection.sock not in self._all:
            return  # closed earlier in this very turn
        talker = connection.robot or connection.pending
        try:
            if mask & WRITE:
                with self._shared.lock:
                    connection.write()
            if mask & READ:
                self._read(connection)
            self._watch(connection)
        except Exception as error:
            self.contain(error, talker, connection)

    def _read(self, connection: Connection) -> None:
        if not connection.read():
            return
        try:
            while not connection.finishing and (packet := connection.inbox.next()) is not None:
                self._receive(connection, packet)
        except WireError as error:
            self._reject(connection, error)

    def _receive(self, connection: Connection, packet: bytes) -> None:
        """Acts on one packet; raises WireError where no robot sends it here."""
        now_ns = self._shared.clock()
        talker = connection.robot or connection.pending
        if talker is None:
            self._greet(connection, packet, now_ns)
            return
        peer = talker.peer
        if packet[3] == PacketType.TELEMETRY:
            with self._shared.lock:
                if isinstance(talker, PendingSession):
                    events = self.prove(talker, packet, None, now_ns)
                else:
                    _, events = talker.receive(packet, None, now_ns)
            self._shared.notify_all(events)
            if peer.fault in LOST_STREAM_CODES:
                raise WireError(peer.fault, "TCP")
            return
        try:
            header, body = peer.open_packet(packet)
        except WireError as error:
            if self._is_doubtful(connection.robot, packet, error, now_ns):
                return
            raise
        if header.type != PacketType.GOODBYE or header.session != peer.session:
            raise WireError(lib.VS_ERR_TYPE, "TCP")
        notice = decode_body(header, body)
        assert isinstance(notice, Notice)
        self._leave(connection, notice, now_ns)

    def _is_doubtful(
        self, robot: HostSession | None, packet: bytes, error: WireError, now_ns: int
    ) -> bool:
        """Whether a packet is a goodbye that its robot has not said: it is told, no more."""
        if robot is None or packet[3] != PacketType.GOODBYE or error.code != lib.VS_ERR_TAG:
            return False
        text = f"{robot.label}: somebody without its key says goodbye in its name; it stays"
        self._shared.notify(LinkEvent("doubt", robot.tag, text, now_ns))
        return True

    def _leave(self, connection: Connection, notice: Notice, now_ns: int) -> None:
        """A robot says goodbye; one that had not shown who it is goes unmentioned."""
        robot = connection.robot
        with self._shared.lock:
            events = [] if robot is None else [robot.left(notice, now_ns)]
            self._part(connection, b"", now_ns)
        self._shared.notify_all(events)

    def prove(
        self, pending: PendingSession, packet: bytes, source: Address | None, now_ns: int
    ) -> list[LinkEvent]:
        """Opens a session that was offered if a packet is a valid one of it; under the lock.

        Gives what to tell; `pending.peer.fault` says why it was none.
        """
        proved = self._shared.roster.prove(pending, packet, source, now_ns)
        if proved is None:
            return []
        connection = next(c for c in self._all.values() if c.pending is pending)
        if proved.refusal:
            self._part(connection, proved.refusal, now_ns)
            return proved.events
        robot = pending.robot
        replaced = self._by_tag.get(robot.tag)
        if replaced is not None:
            self._part(replaced, proved.farewell, now_ns)
        connection.robot, connection.pending = robot, None
        self._greeted.remove(connection)
        self._by_tag[robot.tag] = connection
        self._opened()
        return proved.events

    def _greet(self, connection: Connection, packet: bytes, now_ns: int) -> None:
        with self._shared.lock:
            answer = self._shared.roster.greet(packet, connection.origin, now_ns)
            connection.pending = answer.pending
            if answer.pending is None:
                self._part(connection, answer.packet, now_ns)
            else:
                # A robot that joins in mid-run has its readings with the welcome.
                connection.deadline_ns = now_ns + HELLO_NS
                connection.outbox.put(answer.packet)
                if state := self._offered(answer.pending):
                    connection.outbox.put_state(state)
                connection.write()
        if answer.pending is not None:
            self._strangers.remove(connection)
            self._make_way(self._greeted.add(connection, answer.pending.robot.tag))
        if answer.event is not None:
            self._shared.notify(answer.event)

    def _reject(self, connection: Connection, error: WireError) -> None:
        """Ends a connection whose peer broke the protocol; a robot gets the reason."""
        now_ns, origin = self._shared.clock(), connection.origin
        if connection.robot is not None:
            text = f"{connection.robot.label}: broke the protocol: {error}"
            self._shared.notify(LinkEvent("protocol_error", connection.robot.tag, text, now_ns))
            self.dismiss(connection.robot, GoodbyeCause.PROTOCOL, str(error))
        elif error.code == lib.VS_ERR_MAGIC:
            self._report(connection, f"not a robot: {error}")
            self._drop(connection)
        else:
            tag = connection.inbox.older_tag if error.code == lib.VS_ERR_VERSION else None
            with self._shared.lock:
                roster = self._shared.roster
                if tag is not None:
                    answer = roster.refuse_older(tag, origin, now_ns)
                else:
                    text = connection.inbox.newer or str(error)
                    answer = roster.refuse(RefuseCode.HELLO, text, origin, now_ns)
                self._part(connection, answer.packet, now_ns)
            self._shared.notify_all(filter(None, [answer.event]))

    # --- who goes

    def contain(
        self,
        error: Exception,
        talker: HostSession | PendingSession | None,
        connection: Connection | None = None,
    ) -> None:
        """Ends what one robot or stranger has here after a defect, which is told and counted.

        Whatever was left undone: neither its session nor a connection of it may stay half open.
        """
        robot = talker.robot if isinstance(talker, PendingSession) else talker
        with self._shared.lock:
            now_ns = self._shared.clock()
            for other in list(self._all.values()):
                is_its = robot is not None and other.robot is robot
                if is_its or other is connection or (talker and other.pending is talker):
                    self._part(other, self._shared.last_word(robot, error, now_ns), now_ns)
            if robot is not None:
                robot.close()
                robot.defects += 1
        self._shared.tell_defect(error, robot, connection.origin if connection else "")

    def dismiss(self, robot: HostSession, cause: GoodbyeCause, text: str) -> None:
        """Ends a robot's session, if it has one."""
        if (connection := self._by_tag.get(robot.tag)) and connection.robot is robot:
            with self._shared.lock:
                now_ns = self._shared.clock()
                packet = robot.goodbye(cause, text, self._shared.roster.orders.run, now_ns)
                robot.close()
                self._part(connection, packet, now_ns)

    def _part(self, connection: Connection, last: bytes, now_ns: int) -> None:
        """Ends a connection with one last packet; its robot no longer talks here."""
        robot = connection.robot
        if robot is not None and self._by_tag.get(robot.tag) is connection:
            del self._by_tag[robot.tag]
        self._withdraw(connection)
        connection.finish(last, now_ns + FINISH_NS)
        self.dirty.add(connection)

    def _withdraw(self, connection: Connection) -> None:
        """Forgets the session that was offered on a connection."""
        if connection.pending is not None:
            self._shared.roster.withdraw(connection.pending)
            connection.pending = None

    def _watch(self, connection: Connection) -> None:
        """Has the selector wait for what the connection needs, or drops a broken one."""
        if connection.sock not in self._all:
            return
        if connection.broken:
            self._drop(connection)
            return
        mask = READ | (WRITE if connection.outbox else 0)
        if self._selector.get_key(connection.sock).events != mask:
            self._selector.modify(connection.sock, mask, partial(self._serve, connection))

    def _drop(self, connection: Connection) -> None:
        """Closes a connection, and the session that was open on it."""
        del self._all[connection.sock]
        self._strangers.remove(connection)
        self._greeted.remove(connection)
        self._selector.unregister(connection.sock)
        events: list[LinkEvent] = []
        with self._shared.lock:
            self._withdraw(connection)
            if (robot := connection.robot) is not None:
                connection.robot = None
                self._by_tag.pop(robot.tag, None)
                events = robot.broke(connection.broken or "was closed", self._shared.clock())
        connection.close()
        self._shared.notify_all(events)
