"""This host's networks, and what is told of a camera that is on none of them."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from ipaddress import IPv4Interface

import pytest

from tests.conftest import require_tool
from vsense.vision.cameras._networks import Network, networks, stranded

KNOWN = [
    Network("lo", IPv4Interface("127.0.0.1/8")),
    Network("eth0", IPv4Interface("10.1.2.3/16")),
    Network("eth1", IPv4Interface("192.168.10.1/24")),
]


def test_this_host_is_on_its_own_loopback() -> None:
    assert Network("lo", IPv4Interface("127.0.0.1/8")) in networks()


@pytest.fixture
def space() -> Iterator[str]:
    """A network namespace whose interface p1 has three addresses, the last one with a label."""
    ip, name = require_tool("ip", "iproute2"), f"vsnet{os.getpid() % 100_000}"
    made = subprocess.run([ip, "netns", "add", name], capture_output=True, text=True)
    if made.returncode != 0:
        pytest.skip(f"no network namespaces here: {made.stderr.strip()}")
    try:
        for words in (
            ("link", "add", "p1", "type", "veth", "peer", "name", "p2"),
            ("addr", "add", "10.9.0.1/24", "dev", "p1"),
            ("addr", "add", "192.168.10.1/16", "dev", "p1"),
            ("addr", "add", "192.168.11.1/24", "label", "p1:2", "dev", "p1"),
            ("link", "set", "p1", "up"),
        ):
            subprocess.run([ip, "-n", name, *words], check=True)
        yield name
    finally:
        subprocess.run([ip, "netns", "del", name], check=True)


def test_each_address_of_an_interface_leads_to_it(space: str) -> None:
    code = (
        "from vsense.vision.cameras._networks import interface_of, networks\n"
        "for each in networks(): print(each, interface_of(str(each.address.ip)))\n"
        "print(interface_of('10.9.0.2'))"
    )
    done = subprocess.run(
        ["ip", "netns", "exec", space, sys.executable, "-c", code], capture_output=True, text=True
    )
    assert done.stdout.splitlines() == [
        "p1 10.9.0.1/24 p1",
        "p1 192.168.10.1/16 p1",
        "p1 192.168.11.1/24 p1",
        "None",
    ], done.stderr


def test_a_camera_on_one_of_the_networks_is_well() -> None:
    assert stranded("192.168.10.77", KNOWN) == ""
    assert stranded("10.1.200.1", KNOWN) == ""
    assert stranded("", KNOWN) == "", "USB3 cameras have no address"


def test_a_camera_elsewhere_is_told_with_both_sides() -> None:
    text = stranded("192.168.11.12", KNOWN)
    assert "192.168.11.12" in text and "192.168.11.1/24" in text
    assert "eth0 10.1.2.3/16, eth1 192.168.10.1/24" in text
    assert "lo" not in text.split(), "nobody plugs a camera in there"


def test_the_proposed_address_is_not_the_cameras_own() -> None:
    assert "this host 192.168.11.2/24" in stranded("192.168.11.1", KNOWN)


def test_a_camera_that_nobody_gave_an_address_is_told_apart() -> None:
    text = stranded("169.254.7.9", KNOWN)
    assert "nobody gave it an address" in text and "DHCP" in text


def test_a_host_without_any_network() -> None:
    assert "this host is on no network" in stranded("192.168.11.12", KNOWN[:1])
