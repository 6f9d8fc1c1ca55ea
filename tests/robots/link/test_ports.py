"""One port number for TCP and UDP, whole or not at all."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing

import pytest

from vsense.robots.link.network import Ports, bind
from vsense.robots.link.status import LinkError


@pytest.fixture
def taken() -> Iterator[Ports]:
    """A server's two sockets."""
    ports = bind("127.0.0.1", 0)
    yield ports
    ports.tcp.close()
    ports.udp.close()


def test_both_sockets_have_the_same_number_and_do_not_block(taken: Ports) -> None:
    assert taken.tcp.getsockname() == taken.udp.getsockname() == ("127.0.0.1", taken.port)
    assert not taken.tcp.getblocking() and not taken.udp.getblocking()
    assert taken.tcp.getsockopt(socket.SOL_SOCKET, socket.SO_ACCEPTCONN)


@pytest.mark.parametrize("host", ["127.0.0.1", "0.0.0.0", "localhost"])
def test_a_second_server_is_refused_with_one_clear_line(taken: Ports, host: str) -> None:
    with pytest.raises(LinkError) as caught:
        bind(host, taken.port)
    text = str(caught.value)
    assert text.startswith(f"TCP port {taken.port} on ") and " is in use: process " in text
    assert "\n" not in text


def test_who_has_a_port_is_named(taken: Ports) -> None:
    with pytest.raises(LinkError, match=rf"process {os.getpid()} \(.*, since \d\d \w+ \d\d:\d\d\)"):
        bind("127.0.0.1", taken.port)
    command = (
        "import socket; s = socket.create_server(('127.0.0.1', 0));"
        " print(s.getsockname()[1], flush=True); input()"
    )
    words = [sys.executable, "-c", command, "/x/vsense", "lab", "pollutant"]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as lab:
        assert lab.stdin is not None and lab.stdout is not None
        port = int(lab.stdout.readline())
        with pytest.raises(LinkError, match=rf"process {lab.pid} \(vsense lab pollutant, since "):
            bind("127.0.0.1", port)
        lab.stdin.write("\n")


@pytest.mark.parametrize(("mine", "kind"), [("udp", "TCP"), ("tcp", "UDP")])
def test_half_a_port_is_not_enough(taken: Ports, mine: str, kind: str) -> None:
    """Whichever half another program has: the server does not start, and keeps nothing."""
    getattr(taken, mine).close()
    for _ in range(2):
        with pytest.raises(LinkError, match=f"{kind} port {taken.port} .* is in use"):
            bind("127.0.0.1", taken.port)


def test_a_restart_finds_its_port_free_at_once(taken: Ports) -> None:
    """Connections of the old server in TIME_WAIT do not count."""
    with closing(socket.create_connection(("127.0.0.1", taken.port))) as client:
        taken.tcp.setblocking(True)
        accepted, _ = taken.tcp.accept()
        accepted.close()
        assert client.recv(1) == b""
    taken.tcp.close()
    taken.udp.close()
    again = bind("127.0.0.1", taken.port)
    again.tcp.close()
    again.udp.close()


@pytest.mark.parametrize(
    ("host", "expected"),
    [
        ("192.0.2.1", "TCP port 0 on 192.0.2.1 is not an address of this machine"),
        ("no such host", "cannot listen on 'no such host': "),
        ("x" * 64 + ".example", "cannot listen on 'xxx"),
    ],
)
def test_a_wrong_host_is_named(host: str, expected: str) -> None:
    with pytest.raises(LinkError) as caught:
        bind(host, 0)
    assert str(caught.value).startswith(expected)


def test_ipv6_is_served_too() -> None:
    try:
        ports = bind("::1", 0)
    except LinkError:
        pytest.skip("needs IPv6 on the loopback interface")
    assert ports.tcp.getsockname()[:2] == ("::1", ports.port)
    ports.tcp.close()
    ports.udp.close()
