"""What cameras take of the network that they share."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest

from vsense.vision.cameras._networks import (
    BandwidthError,
    NetworkLoad,
    Stream,
    answers,
    controlled,
    host_address,
    interface_of,
    speed_bit_s,
)

SIZE = (1620, 1220)
GIGABIT = 1e9


def links(speed: float | None = GIGABIT, way: str | None = "eth1") -> NetworkLoad:
    return NetworkLoad(lambda address: way, lambda interface: speed)


@pytest.mark.parametrize(
    "stream, bit_s",
    [
        # One packet of 1464 bytes of pixels, leader and trailer: 3 x 74 bytes around them.
        (Stream((61, 24), 1.0), 8 * (1464 + 3 * 74)),
        (Stream((61, 25), 1.0), 8 * (1525 + 4 * 74)),
        (Stream((61, 24), 10.0, bits_per_px=16), 80 * (2928 + 4 * 74)),
        # The thesis's cameras: 1 976 400 bytes in 1350 packets, or in 221 jumbo packets.
        (Stream(SIZE, 10.0), 80 * (1_976_400 + 1353 * 74)),
        (Stream(SIZE, 10.0, 9000), 80 * (1_976_400 + 223 * 74)),
    ],
)
def test_a_stream_is_its_pixels_and_what_is_around_them(stream: Stream, bit_s: float) -> None:
    assert stream.bit_s == pytest.approx(bit_s, rel=1e-3)


def test_what_the_network_does_not_carry_is_refused_with_the_sum() -> None:
    shared = links()
    for number in range(6):
        shared.claim(f"cam{number}", f"10.0.0.{number}", Stream(SIZE, 9.5))
    with pytest.raises(BandwidthError) as refused:
        shared.claim("cam6", "10.0.0.6", Stream(SIZE, 9.5))
    assert str(refused.value) == (
        "eth1 carries 1000 Mbit/s, the cameras on it would send 158 (cam0) + 158 (cam1)"
        " + 158 (cam2) + 158 (cam3) + 158 (cam4) + 158 (cam5) + 158 (cam6) = 1105 Mbit/s:"
        " expected a lower frame_rate, smaller pictures, or another network for some of them"
    )
    # Nothing was noted of it: a slower one still fits.
    shared.claim("cam6", "10.0.0.6", Stream(SIZE, 3.0))


def test_a_camera_that_comes_back_is_not_counted_twice() -> None:
    shared = links()
    for _ in range(3):
        shared.claim("a", "10.0.0.1", Stream(SIZE, 50.0))


def test_other_networks_and_those_that_tell_no_speed_do_not_count() -> None:
    for shared in (links(None), links(way=None)):
        shared.claim("a", "10.0.0.1", Stream(SIZE, 900.0))
    ways = {"10.0.0.1": "eth1", "10.0.1.1": "eth2"}
    shared = NetworkLoad(ways.get, lambda interface: GIGABIT)
    for address in ways:
        shared.claim(address, address, Stream(SIZE, 50.0))


def test_any_number_of_threads_may_claim() -> None:
    shared, refused = links(), []

    def claim(number: int) -> None:
        try:
            shared.claim(str(number), f"10.0.0.{number}", Stream(SIZE, 9.5))
        except BandwidthError:
            refused.append(number)

    threads = [threading.Thread(target=claim, args=(n,)) for n in range(20)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(refused) == 14


def test_this_machine_knows_the_way_to_itself() -> None:
    assert host_address("127.0.0.1") == "127.0.0.1"
    assert interface_of("127.0.0.1") == "lo"
    assert interface_of("203.0.113.77") is None
    assert host_address("no address") is None


@pytest.mark.parametrize(
    "text, bit_s", [("1000\n", 1e9), ("-1\n", None), ("", None), ("fast", None)]
)
def test_an_interface_says_what_it_carries_or_does_not(
    tmp_path: Path, text: str, bit_s: float | None
) -> None:
    (tmp_path / "eth1").mkdir()
    (tmp_path / "eth1" / "speed").write_text(text)
    assert speed_bit_s("eth1", tmp_path) == bit_s
    assert speed_bit_s("eth9", tmp_path) is None


def test_where_no_camera_is_none_answers() -> None:
    assert not answers("127.77.77.77")
    assert not controlled("127.77.77.77")
