"""PROTOCOL.md and the headers say the same numbers and names."""

from __future__ import annotations

import re

import pytest

from tests.rigs.places import ROOT
from vsense.base.native import lib
from vsense.robots.link.wire import GoodbyeCause, PacketType, RefuseCode

TEXT = (ROOT / "c_src" / "PROTOCOL.md").read_text()


def sections() -> dict[str, str]:
    """Text by heading."""
    parts = re.split(r"^## \d+\. (.*)$", TEXT, flags=re.MULTILINE)
    return dict(zip(parts[1::2], parts[2::2]))


def test_packet_types_and_limits() -> None:
    rows = re.findall(r"^\| (\d+) \| ([A-Z]+) \| \w+ \| (\d+) \|$", TEXT, re.MULTILINE)
    assert [(PacketType[name], name) for _, name, _ in rows] == [
        (PacketType(int(number)), name) for number, name, _ in rows
    ]
    assert [lib.vs_packet_limit(int(number)) for number, _, _ in rows] == [
        int(limit) for _, _, limit in rows
    ]
    assert len(rows) == len(PacketType)


def test_codes() -> None:
    rows = dict(re.findall(r"\| (\d) \| ([A-Z_]+): [^|]*\| *$", TEXT, re.MULTILINE))
    assert rows == {str(int(cause)): cause.name for cause in GoodbyeCause}
    rows = dict(re.findall(r"^\| (\d) \| ([A-Z_]+): ", TEXT, re.MULTILINE))
    assert rows == {str(int(code)): code.name for code in RefuseCode}


def test_header_fields_lie_side_by_side() -> None:
    rows = re.findall(r"^\| (\d+) \| u(\d+) \| (\w+) \|", sections()["Frame"], re.MULTILINE)
    end = 0
    for offset, bits, name in rows:
        assert int(offset) == end, name
        end += int(bits) // 8
    assert end == lib.VS_HEADER_SIZE


@pytest.mark.parametrize("name", re.findall(r"^\| ([A-Z_]+) \|", TEXT, re.MULTILINE))
def test_errors_exist(name: str) -> None:
    if name in ("TCP", "UDP", "REFUSE"):
        return
    assert hasattr(lib, f"VS_ERR_{name}")


def test_limits_of_the_table() -> None:
    text = sections()["Sensor table"]
    assert f"at most {lib.VS_TABLE_MAX})" in text
    assert f"at most {lib.VS_SENSOR_BYTES}," in text
    assert f"at most {lib.VS_ACTUATOR_BYTES}." in text
    fixed = lib.VS_DATAGRAM_MAX - lib.VS_PACKET_MIN
    assert fixed - lib.VS_SENSOR_BYTES == 16
    notes = 1 + lib.VS_LOG_MAX + 1 + lib.VS_SHOWN_MAX
    assert fixed - notes - lib.VS_ACTUATOR_BYTES == 68
