"""A TCP stream without its socket: any chunking in, any partial writes out."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsense.base.native import WireError, lib
from vsense.robots.link._streams import Inbox, Outbox
from vsense.robots.link.wire import DATAGRAM_MAX, Header, Notice, PacketType, encode

packets = st.builds(
    lambda text: encode(Header(PacketType.GOODBYE), Notice(0, text)),
    st.text("abc ", max_size=200),
)


@given(sent=st.lists(packets, max_size=8), data=st.data())
def test_defect_01_any_chunking_gives_the_same_packets(
    sent: list[bytes], data: st.DataObject
) -> None:
    stream, inbox, got = b"".join(sent), Inbox(), []
    while stream:
        count = data.draw(st.integers(1, inbox.room))
        inbox.feed(stream[:count])
        stream = stream[count:]
        while (packet := inbox.next()) is not None:
            got.append(packet)
    assert got == sent


@given(st.binary(max_size=3 * DATAGRAM_MAX))
def test_any_bytes_give_packets_or_one_error_in_bounded_memory(stream: bytes) -> None:
    inbox = Inbox()
    try:
        while stream:
            assert 1 <= inbox.room <= DATAGRAM_MAX
            inbox.feed(stream[: inbox.room])
            stream = stream[inbox.room :]
            while inbox.next() is not None:
                pass
    except WireError as error:
        assert error.name.startswith("VS_ERR_")


@given(st.integers(DATAGRAM_MAX + 1, 65535), st.sampled_from(PacketType))
def test_defect_07_a_length_from_the_wire_is_checked_before_its_use(
    length: int, kind: PacketType
) -> None:
    inbox = Inbox()
    inbox.feed(struct.pack("<HBBHH", lib.VS_MAGIC, lib.VS_VERSION, kind, 0, length))
    with pytest.raises(WireError, match="length"):
        inbox.next()


def test_an_inbox_takes_no_more_than_it_has_room_for() -> None:
    with pytest.raises(ValueError, match="1201 bytes"):
        Inbox().feed(bytes(DATAGRAM_MAX + 1))


@given(st.lists(st.one_of(st.none(), st.integers(1, 40)), max_size=60), st.data())
def test_packets_leave_whole_and_of_state_the_newest(
    steps: list[int | None], data: st.DataObject
) -> None:
    """None puts a new STATE in, a number is how many bytes the kernel takes."""
    outbox, wire, made, replaced = Outbox(), b"", 0, 0
    for step in steps:
        if step is None:
            made += 1
            replaced += outbox.put_state(b"<%04d>" % made)
        else:
            taken = bytes(outbox.chunk()[:step])
            outbox.wrote(len(taken))
            wire += taken
    while outbox:
        wire += outbox.chunk()
        outbox.wrote(len(outbox.chunk()))
    numbers = [int(part.strip(b"<>")) for part in wire.replace(b"><", b"> <").split()]
    assert wire == b"".join(b"<%04d>" % number for number in numbers)
    assert numbers == sorted(set(numbers))
    assert numbers[-1:] == [made][: len(numbers)]
    assert len(numbers) == made - replaced


def test_ordered_packets_go_first_and_nothing_follows_a_goodbye() -> None:
    outbox = Outbox()
    outbox.put_state(b"state")
    outbox.put(b"welcome")
    assert outbox.chunk() == b"welcome"
    outbox.wrote(3)
    outbox.drop_state()
    outbox.put(b"goodbye")
    assert outbox.chunk() == b"come"
    outbox.wrote(4)
    assert outbox.chunk() == b"goodbye"
    outbox.wrote(7)
    assert not outbox and not outbox.chunk()
