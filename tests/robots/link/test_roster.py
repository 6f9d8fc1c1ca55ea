"""Who may join, and the answer to every greeting."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.wire.robot_session import next_nonce
from vsense.base.native import WireError, ffi, lib
from vsense.robots.link._roster import Proved, SessionTable
from vsense.robots.link._session import PendingSession
from vsense.robots.link.keys import INSECURE
from vsense.robots.link.status import EventThrottle, LinkEvent, cut_text
from vsense.robots.link.table import (
    Direction,
    Entry,
    ExpectedRobot,
    Output,
    Table,
    ToldProgram,
)
from vsense.robots.link.wire import (
    PUBLISHED,
    TEXT_MAX,
    GoodbyeCause,
    Header,
    Hello,
    Notice,
    PacketType,
    RefuseCode,
    Welcome,
    answer_key,
    decode,
    encode,
    header_to,
    session_keys,
)
from vsense.run.robots import Readiness

S = 1_000_000_000
TABLE = Table([Entry(1, "pollutant", "f4")])


def roster(draws: Iterable[int] = range(1, 100)) -> SessionTable:
    numbers = iter(draws)
    expected = {tag: ExpectedRobot(f"epuck_{tag}", TABLE) for tag in (5, 6)}
    return SessionTable(expected, 10**8, 1, INSECURE, lambda: next(numbers))


def join(
    ours: SessionTable, packet: bytes, origin: str, now_ns: int
) -> tuple[LinkEvent, Proved | None]:
    """A robot without a key greets and, if it may, says its first word; gives what was told."""
    answer = ours.greet(packet, origin, now_ns)
    if answer.pending is None:
        assert answer.event is not None
        return answer.event, None
    _, up = session_keys(PUBLISHED, packet, answer.packet)
    proved = ours.prove(answer.pending, first_word(answer.pending, up), None, now_ns)
    assert proved is not None
    return proved.events[0], proved


def first_word(pending: PendingSession, key: bytes) -> bytes:
    """The first TELEMETRY of a session that was offered."""
    head, out = Header(PacketType.TELEMETRY, session=pending.peer.session), Output(1200)
    header = header_to(head._replace(sequence=1, table_hash=TABLE.hash))
    kept = header.key = ffi.new("uint8_t[]", key)
    telemetry = ffi.new("struct vs_telemetry *")
    packet = out.packet(lib.vs_encode_telemetry(header, TABLE.cdata, telemetry, *out.arguments))
    assert kept == header.key
    return packet


def hello(tag: int, uid: bytes = b"a") -> bytes:
    return said(Hello(uid.ljust(16), tag, "name", "test"))


def said(greeting: Hello) -> bytes:
    """A greeting as a robot sends it: its nonce is no other's."""
    return encode(Header(PacketType.HELLO, send_ns=77), replace(greeting, nonce=next_nonce()))


def test_the_welcome_carries_session_table_and_the_echo_of_the_greeting() -> None:
    packet = hello(5)
    answer = roster([1234]).greet(packet, "here", S)
    header, welcome = decode(answer.packet, answer_key(PUBLISHED, packet))
    assert isinstance(welcome, Welcome)
    assert (header.session, header.table_hash, header.run) == (1234, TABLE.hash, 1)
    assert (header.send_ns, header.echo_ns, header.hold_us) == (S, 77, 0)
    assert (welcome.table, welcome.timestep_us) == (TABLE, 100_000)


def test_session_numbers_are_never_0_nor_one_that_was_just_used() -> None:
    ours = roster([0, 9, 9, 0, 8, 8, 9, 7])
    for tag, expected in ((5, 9), (6, 8), (5, 7)):
        join(ours, hello(tag), "here", S)
        robot = ours.robots[tag]
        assert robot.peer.session == expected
        assert ours.of_session(expected) is robot
    assert ours.of_session(9) is None and ours.of_session(0) is None


def test_a_takeover_says_goodbye_to_the_old_connection() -> None:
    ours = roster([3, 4])
    _, first = join(ours, hello(5), "here", S)
    assert first is not None and first.farewell == b""
    ours.robots[5].address = ("10.0.0.5", 1)
    key = bytes(ours.robots[5].peer._peer.tx_key)
    event, proved = join(ours, hello(5), "there", S)
    assert ours.robots[5].address is None  # no datagram of the new session has come
    assert event.kind == "takeover" and proved is not None
    assert event.text.endswith("without a key; the old one, from here, is closed")
    header, notice = decode(proved.farewell, key)
    assert isinstance(notice, Notice)
    assert (header.session, notice.code) == (3, GoodbyeCause.TAKEN_OVER)


@pytest.mark.parametrize(
    ("uid", "after_ns", "kind"),
    [
        (b"a", 0, "takeover"),
        (b"a", S, "reconnected"),
        (b"b", 0, "refused"),
        (b"b", S - 1, "refused"),
        (b"b", S, "connected"),
    ],
)
def test_who_gets_a_tag_that_was_given_before(uid: bytes, after_ns: int, kind: str) -> None:
    ours = roster()
    join(ours, hello(5), "here", S)
    event, proved = join(ours, hello(5, uid), "there", S + after_ns)
    assert (event.kind, event.tag) == (kind, 5)
    assert (proved is None) == (kind == "refused")


@pytest.mark.parametrize(
    ("uptime_s", "words"),
    [
        (20, "robot 5: was switched on again (battery swapped?), up for 20 s; reconn"),
        (560, "robot 5: reconnected from"),  # its daemon alone began anew
    ],
)
def test_a_battery_swap_is_an_event(uptime_s: int, words: str) -> None:
    ours = roster()
    for started, up_s, now_ns in ((1, 500, S), (2, uptime_s, 61 * S)):
        told = Hello(b"a".ljust(16), 5, "name", "test", started=started, uptime_s=up_s)
        event, _ = join(ours, said(told), "there", now_ns)
    assert event.kind == "reconnected" and event.text.startswith(words)


def test_of_two_that_greeted_at_once_the_first_that_proves_has_the_tag() -> None:
    ours = roster()
    words = []
    for uid in (b"a", b"b"):
        packet = hello(5, uid)
        answer = ours.greet(packet, "here", S)
        assert answer.pending is not None, "nobody has the tag yet"
        _, up = session_keys(PUBLISHED, packet, answer.packet)
        words.append((answer.pending, first_word(answer.pending, up)))
    (late, late_word), (early, early_word) = words
    opened = ours.prove(early, early_word, None, S)
    assert opened is not None and opened.refusal == b""
    refused = ours.prove(late, late_word, None, S)
    assert refused is not None and refused.refusal and refused.farewell == b""
    assert [event.kind for event in refused.events] == ["refused"]
    assert ours.of_session(early.peer.session) is ours.robots[5]
    assert ours.of_session(late.peer.session) is None


def test_a_broken_connection_does_not_free_the_tag_before_a_second_is_over() -> None:
    ours = roster()
    join(ours, hello(5), "here", S)
    ours.robots[5].broke("was closed", S)
    assert join(ours, hello(5, b"b"), "there", S + 1)[0].kind == "refused"
    assert join(ours, hello(5), "there", S + 1)[0].kind == "reconnected"


def test_only_hello_opens_a_session() -> None:
    with pytest.raises(WireError, match="first packet"):
        roster().greet(encode(Header(PacketType.GOODBYE), Notice(0)), "here", S)


def test_parameters_that_no_welcome_can_carry_are_refused_before_the_start() -> None:
    for timestep_ns, params in ((10**8, "x" * 4097), (10**8, "a\tb"), (0, "")):
        with pytest.raises(WireError):
            SessionTable({5: ExpectedRobot("five", TABLE, params)}, timestep_ns, 1, INSECURE)


def test_the_list_of_expected_tags_is_cut_to_what_refuse_can_carry() -> None:
    many = SessionTable(
        dict.fromkeys(range(1000), ExpectedRobot("robot", TABLE)), 10**8, 1, INSECURE
    )
    packet = hello(5000)
    answer = many.greet(packet, "here", S)
    notice = decode(answer.packet, answer_key(PUBLISHED, packet))[1]
    assert isinstance(notice, Notice) and len(notice.text) == TEXT_MAX
    assert answer.event is not None and "998, 999. Its markers" in answer.event.text


@given(st.text(st.characters(codec="utf-8"), max_size=300))
def test_a_cut_text_fits_and_is_a_beginning(text: str) -> None:
    short = cut_text(text)
    assert text.startswith(short) and len(short.encode()) <= TEXT_MAX
    assert short == text or len(short.encode()) > TEXT_MAX - 4


def test_a_greeting_counts_once_from_few_addresses_until_the_robot_is_there() -> None:
    ours = roster()
    join(ours, hello(5), "home", S)
    packet = hello(5)
    origins = ("a", "a", "b", "b", "c", "home", "home", "c")
    answers = {number: ours.greet(packet, o, S) for number, o in enumerate(origins)}
    assert [number for number, a in answers.items() if a.pending is not None] == [0, 2, 5]
    refused = [a.event for a in answers.values() if a.pending is None]
    assert all(event is not None and "robot 5" in event.text for event in refused)
    packet = hello(5)
    assert join(ours, packet, "d", S)[1] is not None
    assert all(ours.greet(packet, origin, S).pending is None for origin in "abd")


def test_complaints_are_not_repeated_every_time() -> None:
    told: list[LinkEvent] = []
    throttle = EventThrottle(told.append)
    for time_ns in (0, S, 9 * S, 10 * S, 11 * S):
        throttle.notify(LinkEvent("refused", 5, "tag in use", time_ns))
        throttle.notify(LinkEvent("lost", 5, "nothing heard", time_ns))
    assert [e.time_ns // S for e in told if e.kind == "refused"] == [0, 10]
    assert len([e for e in told if e.kind == "lost"]) == 5


def test_many_different_complaints_are_few_lines_and_then_a_number() -> None:
    told: list[LinkEvent] = []
    throttle = EventThrottle(told.append, expected=(5,))
    for number in range(1000):
        throttle.notify(LinkEvent("refused", number + 100, str(number), S, f"10.0.0.{number % 3}"))
        throttle.notify(LinkEvent("refused", 5, str(number), S, "10.0.0.9"))
    assert [e.text for e in told if e.tag == 5] == ["0", "1"]
    assert [e.text for e in told if e.tag != 5] == list("01234567")
    assert len(throttle._sent) == 10
    throttle.tick(10 * S)
    assert len(told) == 10
    throttle.tick(11 * S)
    assert told[10].kind == "protocol_error" and told[10].text == (
        "robots' port: 992 more from 10.0.0.2 and 2 other addresses in the last 10 s: refused (992)"
    )
    throttle.tick(30 * S)
    assert len(told) == 11, "nothing happened, nothing is told"
    throttle.notify(LinkEvent("refused", 5, "7", 30 * S))
    assert told[11].text == "7"


@pytest.mark.parametrize(
    ("rooms", "lacks"),
    [
        ({"params_room": 602}, "603 bytes of params, of 602"),
        ({"entries_room": 3}, "4 sensors and actuators, of 3"),
        ({"datagram_room": 561}, "562 bytes a packet, of 561"),
        ({"params_room": 0, "entries_room": 0}, "603 bytes of params, of 0; 4 sensors and act"),
        ({"params_room": 603, "entries_room": 4, "datagram_room": 562}, ""),
    ],
)
@pytest.mark.parametrize("up", [False, True])
def test_a_robot_without_room_for_the_experiment_is_refused(
    rooms: dict[str, int], lacks: str, up: bool
) -> None:
    """Either STATE or TELEMETRY is the longer packet, by PROTOCOL.md's sections 2 and 3."""
    entries = [Entry(1, "a", "u1"), Entry(2, "b", "u1", Direction.ACTUATOR)]
    if up:  # 72 + 68 + 1 + (4 + 400) + 15 + 2 = 562
        entries += [Entry(3, "own", "400*u1", Direction.READING)]
        entries += [Entry(4, "c", "15*u1", Direction.ACTUATOR)]
    else:  # 72 + 16 + (4 + 1) + (4 + 400) + (4 + 61) = 562
        entries += [Entry(3, "own", "400*u1"), Entry(4, "c", "61*u1")]
    params = "a=" + "x" * 600 + "\n"
    expected = {5: ExpectedRobot("five", Table(entries), params)}
    ours = SessionTable(expected, 10**8, 1, INSECURE)
    packet = said(Hello(b"a" * 16, 5, "name", "test", **rooms))
    answer = ours.greet(packet, "here", S)
    _, notice = decode(answer.packet, answer_key(PUBLISHED, packet))
    if not lacks:
        assert isinstance(notice, Welcome) and answer.pending is not None
        return
    assert isinstance(notice, Notice) and notice.code == RefuseCode.ROOM
    text = f"the experiment needs more than the robot can hold: {lacks}"
    assert notice.text.startswith(text)
    assert answer.pending is None and answer.event is not None and text in answer.event.text


PREDATOR, PREY = ToldProgram("predator", "1" * 12), ToldProgram("prey", "2" * 12)


def mixed(*programs: ToldProgram | None) -> SessionTable:
    expected = {
        tag: ExpectedRobot(f"epuck_{tag}", TABLE, program=program)
        for tag, program in enumerate(programs, 5)
    }
    return SessionTable(expected, 10**8, 1, INSECURE)


def greeting(tag: int, name: str, digest: str = "") -> bytes:
    return said(Hello(b"a" * 16, tag, "name", name, hash=digest))


@pytest.mark.parametrize(
    ("name", "digest", "taken"),
    [
        ("predator", "1" * 12, True),
        ("renamed", "1" * 12, True),
        ("predator", "", True),
        ("predator", "3" * 12, False),
        ("prey", "2" * 12, False),
        ("prey", "3" * 12, False),
        ("prey", "", False),
        ("predator", "2" * 12, False),
        ("foraging", "4" * 12, False),
    ],
)
def test_a_robot_with_the_program_of_others_is_refused_with_both_names(
    name: str, digest: str, taken: bool
) -> None:
    ours = mixed(PREDATOR, PREY)
    packet = greeting(5, name, digest)
    answer = ours.greet(packet, "here", S)
    assert (answer.pending is not None) == taken
    if not taken:
        assert answer.event is not None
        _, notice = decode(answer.packet, answer_key(PUBLISHED, packet))
        assert isinstance(notice, Notice) and notice.code == RefuseCode.CONTROLLER
        runs = f"'{name}' ({digest})" if digest else f"'{name}'"
        expected = f"robot 5 runs {runs}, the file says 'predator' (111111111111): bring"
        assert notice.text.startswith(expected) and expected in answer.event.text
        assert f"robot 5 {ours.robots[5].status(S).refused}".startswith(expected)
        join(ours, greeting(5, "predator", "1" * 12), "here", S)
        assert ours.robots[5].status(S).refused == ""


@pytest.mark.parametrize(
    ("name", "digest", "taken"),
    [
        ("pollutant", "1" * 12, True),
        ("renamed", "1" * 12, True),
        ("pollutant", "", True),
        ("", "", True),
        ("pollutant", "3" * 12, False),
        ("foraging", "4" * 12, False),
        ("foraging", "", False),
    ],
)
def test_a_robot_with_another_program_is_refused_unless_somebody_wants_it(
    name: str, digest: str, taken: bool
) -> None:
    program = ToldProgram("pollutant", "1" * 12)
    for any_program in (False, True):
        expected = {5: ExpectedRobot("epuck_5", TABLE, program=program, any_program=any_program)}
        ours = SessionTable(expected, 10**8, 1, INSECURE)
        packet = greeting(5, name, digest)
        answer = ours.greet(packet, "here", S)
        assert (answer.pending is not None) == (taken or any_program)
        runs = f"'{name}' ({digest})" if digest else f"'{name}'"
        words = f"runs {runs}, the file says 'pollutant' (111111111111)"
        if answer.pending is None:
            _, notice = decode(answer.packet, answer_key(PUBLISHED, packet))
            assert isinstance(notice, Notice) and notice.code == RefuseCode.CONTROLLER
            assert words in notice.text
            continue
        event, _ = join(ours, greeting(5, name, digest), "here", S)
        assert ours.robots[5].status(S).other_program == ("" if taken else words)
        assert event.text.endswith("without a key" + ("" if taken else f": it {words}"))


@pytest.mark.parametrize("any_program", [False, True])
def test_a_robot_with_the_program_of_another_part_is_never_taken(any_program: bool) -> None:
    parts = {5: PREDATOR, 6: PREY}
    expected = {
        tag: ExpectedRobot(f"epuck_{tag}", TABLE, program=program, any_program=any_program)
        for tag, program in parts.items()
    }
    ours = SessionTable(expected, 10**8, 1, INSECURE)
    assert ours.greet(greeting(5, "prey", "2" * 12), "here", S).pending is None


def test_what_a_daemon_runs_that_was_started_again_counts() -> None:
    ours = mixed(PREDATOR)
    for started, starts in ((7, 1), (7, 1), (9, 2)):
        hello = Hello(b"a" * 16, 5, "name", "predator", hash="1" * 12, started=started)
        join(ours, said(hello), "here", S)
        assert ours.robots[5].status(S).starts == starts


def test_other_robots_are_expected_between_runs_and_who_stays_stays() -> None:
    ours = roster()
    join(ours, hello(5), "a:1", S)
    join(ours, hello(6), "b:1", S)
    kept = ours.robots[5]
    expected = {tag: ExpectedRobot(f"epuck_{tag}", TABLE) for tag in (5, 37)}
    offered = ours.greet(hello(6), "b:2", S).pending
    (gone,) = ours.recast(expected)
    assert (gone.tag, gone.open) == (6, True), "its session is the caller's to end"
    assert ours.robots[5] is kept and kept.open
    assert ours.of_session(gone.peer.session) is None
    # What was offered to who has left is offered no more.
    assert offered is not None and ours.prove(offered, b"", None, S) is None
    refused, _ = join(ours, hello(6), "b:1", 2 * S)
    assert "tag 6 is not in this experiment; expected: 5, 37" in refused.text
    event, _ = join(ours, hello(37), "c:1", 2 * S)
    assert event.kind == "connected" and ours.robots[37].open


def running(tag: int, program: ToldProgram) -> bytes:
    told = Hello(b"a" * 16, tag, "name", program.name, hash=program.hash)
    return said(told)


def test_who_is_put_in_has_the_files_controller_or_that_of_its_fellows() -> None:
    file, older = ToldProgram("ant", "new"), ToldProgram("ant", "old")
    robots = {
        5: ExpectedRobot("a", TABLE, program=file, any_program=True),
        6: ExpectedRobot("b", TABLE, program=file, any_program=True),
    }
    ours = SessionTable(robots, 10**8, 1, INSECURE)
    join(ours, running(5, older), "a:1", S)
    ours.recast({5: robots[5], 37: replace(robots[6], exact=True)})
    for runs in (ToldProgram("ant", "other"), ToldProgram("bee", "new2")):
        event, _ = join(ours, running(37, runs), "c:1", S)
        assert event.kind == "refused" and "with 'vsense robot deploy'" in event.text
        why = ours.robots[37].refused
        words = f"runs '{runs.name}' ({runs.hash}), the file says 'ant' (new): bring"
        assert why.startswith(words)
        assert Readiness.of({37: "b"}, {}, (), (), {37: why}).away == {"b": "robot 37: deploy"}
    for number, runs in enumerate((older, file)):
        event, _ = join(ours, running(37, runs), "c:1", (3 + number) * S)
        assert event.kind in ("connected", "reconnected", "takeover"), event.text
