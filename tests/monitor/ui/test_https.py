"""HTTPS: whose certificate, what clients that are not ours see, and what is refused."""

from __future__ import annotations

import importlib.util
import io
import os
import re
import socket
import ssl
import stat
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import aiohttp
import pytest

from tests.conftest import require_tool
from tests.monitor.ui.browser import Browser
from tests.monitor.ui.puppet import Puppet
from tests.rigs.web import hear, is_closed, read_rest, talk
from vsense.base.errors import UsageError, VsenseError
from vsense.base.terminal import Console
from vsense.commands import parser
from vsense.commands._arguments import web_of
from vsense.monitor.ui import _certificate, _web_listener
from vsense.monitor.ui._watchers import WatchedBus, WebWatcher, page_access
from vsense.monitor.ui.access import WebAddress

PATIENCE_S = 30.0
OPEN = WebAddress("0.0.0.0", 0)


class Page:
    """A page that other machines may open; its puppet runs."""

    def __init__(self, address: WebAddress = OPEN) -> None:
        self.puppet = Puppet()
        self.said = io.StringIO()
        runs = WatchedBus(self.puppet.bus, self.puppet.give, Console(self.said))
        self.page = WebWatcher(page_access(address), runs)
        self.page.start()
        self.lines = self.said.getvalue().splitlines()
        self.server = self.page.server
        self.port = self.server.port
        assert self.server.tokens is not None
        self.query = f"?token={self.server.tokens.control}"

    @property
    def told(self) -> list[str]:
        """What was said since it began."""
        return self.said.getvalue().splitlines()[len(self.lines) :]

    def close(self) -> None:
        self.puppet.end()
        self.page.close()


Open = Callable[..., Page]


@pytest.fixture(autouse=True)
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return tmp_path / "state" / "vsense" / "page.pem"


@pytest.fixture
def opened() -> Iterator[Open]:
    pages: list[Page] = []

    def make(*arguments: Any) -> Page:
        pages.append(Page(*arguments))
        return pages[-1]

    yield make
    for page in pages:
        page.close()


def shown_by_openssl(port: int) -> str:
    """The fingerprint that a client sees."""
    openssl = require_tool("openssl", "openssl")
    talk = [openssl, "s_client", "-connect", f"127.0.0.1:{port}"]
    seen = subprocess.run(talk, input=b"", capture_output=True, timeout=PATIENCE_S, check=True)
    ask = [openssl, "x509", "-noout", "-fingerprint", "-sha256"]
    found = subprocess.run(ask, input=seen.stdout, capture_output=True, check=True).stdout
    return found.decode().strip().partition("=")[2]


def curl(*arguments: str) -> str:
    """What curl prints, headers and all."""
    words = [require_tool("curl", "curl"), "--silent", "--show-error", "--include", *arguments]
    done = subprocess.run(words, capture_output=True, timeout=PATIENCE_S, check=False)
    return (done.stdout + done.stderr).decode(errors="replace")


def test_tokens_leave_the_machine_encrypted(opened: Open, state: Path) -> None:
    page = opened()
    assert re.fullmatch(r"control room: https://\S+/\?token=\S+", page.lines[0])
    assert re.fullmatch(r"control room, to look only: https://\S+/\?token=\S+", page.lines[1])
    (fingerprint,) = re.findall(r"SHA-256 fingerprint is ([0-9A-F:]{95})$", page.lines[2])
    assert shown_by_openssl(page.port) == fingerprint
    assert stat.S_IMODE(state.stat().st_mode) == 0o600
    answer = curl("--cacert", str(state), f"https://localhost:{page.port}/{page.query}")
    assert answer.startswith("HTTP/1.1 200") and "<title>vsense</title>" in answer
    (cookie,) = re.findall(r"(?i)^set-cookie: (.*?)\r?$", answer, re.M)
    assert {"HttpOnly", "Secure", "SameSite=Strict"} <= set(cookie.split("; "))
    assert "certificate" in curl(f"https://localhost:{page.port}/"), "nobody signed it"


def test_another_start_has_the_same_certificate(opened: Open, state: Path) -> None:
    first, second = opened(), opened()
    assert first.lines[2] == second.lines[2]
    assert shown_by_openssl(first.port) == shown_by_openssl(second.port)
    assert [path.name for path in state.parent.iterdir()] == ["page.pem"]


def test_the_page_speaks_over_tls_and_only_with_its_like(opened: Open, state: Path) -> None:
    page = opened()
    trust = ssl.create_default_context(cafile=str(state))
    base = f"https://localhost:{page.port}"
    cookie = f"vsense_{page.port}={page.query.partition('=')[2]}"

    async def order(client: aiohttp.ClientSession) -> Any:
        headers = {"Cookie": cookie, "Origin": base}
        socket = await client.ws_connect(f"{base}/ws", headers=headers, ssl=trust)
        await socket.send_json({"order": "start"})
        answer = await hear(socket, "/answer")
        headers["Origin"] = base.replace("https", "http")
        with pytest.raises(aiohttp.WSServerHandshakeError) as caught:
            await client.ws_connect(f"{base}/ws", headers=headers, ssl=trust)
        return answer["ok"], caught.value.status

    assert talk(order) == (True, 403)


def test_in_a_browser(opened: Open, browser: Browser) -> None:
    page = opened()
    page.puppet.begin()
    window = browser.open("about:blank")
    try:
        window.call("Security.setIgnoreCertificateErrors", ignore=True)
        window.go(f"https://127.0.0.1:{page.port}/{page.query}")
        window.until("window.vsense?.store.arena && vsense.store.run")
        window.click("#emergency")
        for _ in range(300):
            if page.puppet.orders:
                break
            window.value("new Promise(done => setTimeout(done, 50))")
        assert page.puppet.orders[-1].kind.value == "emergency"
        assert window.value("document.cookie") == "", "scripts do not see the token"
    finally:
        window.close()


def test_old_tls_is_refused(opened: Open) -> None:
    page = opened()
    words = [require_tool("openssl", "openssl"), "s_client", "-connect", f"127.0.0.1:{page.port}"]
    old = [*words, "-tls1_1", "-cipher", "ALL:@SECLEVEL=0"]
    assert subprocess.run(old, input=b"", capture_output=True, check=False).returncode != 0
    assert subprocess.run(words, input=b"", capture_output=True, check=False).returncode == 0


@pytest.mark.parametrize("sent", [b"", b"\x16\x03\x01", b"GET / HTTP/1.1\r\nHost: x\r\n\r\n"])
def test_handshakes_that_lead_to_nothing_end(
    opened: Open, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], sent: bytes
) -> None:
    monkeypatch.setattr(_web_listener, "REQUEST_S", 0.6)
    page = opened()
    address = ("127.0.0.1", page.port)
    crowd = [socket.create_connection(address, PATIENCE_S) for _ in range(100)]
    for sock in crowd:
        sock.sendall(sent)
    answer = curl("--insecure", f"https://localhost:{page.port}/{page.query}")
    assert answer.startswith("HTTP/1.1 200")
    assert sum(not is_closed(sock) for sock in crowd) <= _web_listener.UNVOUCHED_PER_ADDRESS
    for sock in crowd:
        sock.settimeout(PATIENCE_S)
        assert b"HTTP" not in read_rest(sock)
    assert 1 <= len(page.told) <= 3
    assert capfd.readouterr() == ("", "")
    for sock in crowd:
        sock.close()


# -- certificates of one's own --------------------------------------------------------------


@pytest.fixture
def pair(tmp_path: Path) -> tuple[Path, Path]:
    """A certificate and its key, by OpenSSL."""
    found, key = tmp_path / "own.crt", tmp_path / "own.key"
    words = [require_tool("openssl", "openssl"), "req", "-x509", "-newkey", "rsa:2048", "-nodes"]
    words += ["-subj", "/CN=lab", "-addext", "subjectAltName=DNS:localhost", "-days", "2"]
    subprocess.run([*words, "-keyout", key, "-out", found], check=True, capture_output=True)
    return found, key


def test_a_given_certificate_is_used(
    opened: Open, pair: tuple[Path, Path], state: Path, tmp_path: Path
) -> None:
    page = opened(WebAddress("0.0.0.0", 0, None, *pair))
    answer = curl("--cacert", str(pair[0]), f"https://localhost:{page.port}/{page.query}")
    assert answer.startswith("HTTP/1.1 200")
    assert len(page.lines) == 2 and not state.exists()
    both = tmp_path / "both.pem"
    both.touch(mode=0o600)
    both.write_bytes(pair[0].read_bytes() + pair[1].read_bytes())
    local = opened(WebAddress("0.0.0.0", 0, None, both))
    assert shown_by_openssl(local.port) == _certificate.fingerprint_of(pair[0])


def test_files_that_are_none(pair: tuple[Path, Path], tmp_path: Path) -> None:
    found, key = pair
    other = tmp_path / "other"
    other.touch(mode=0o600)
    other.write_text("nothing")

    def failure(*files: Path) -> str:
        with pytest.raises(VsenseError) as caught:
            _certificate.tls_of(WebAddress("0.0.0.0", 0, None, *files))
        return str(caught.value)

    assert f"{other} is no certificate with its key" in failure(other)
    assert f"{found} and {other} are no certificate" in failure(found, other)
    assert "No such file or directory" in failure(tmp_path / "missing", key)
    assert "No such file or directory" in failure(found, tmp_path / "missing")
    key.chmod(0o644)
    assert f"others may read or change the page's key (mode 0644): chmod 600 {key}" in failure(
        found, key
    )
    locked = tmp_path / "locked.key"
    words = [require_tool("openssl", "openssl"), "rsa", "-aes256", "-passout", "pass:secret"]
    subprocess.run([*words, "-in", key, "-out", locked], check=True, capture_output=True)
    locked.chmod(0o600)
    assert "without a password" in failure(found, locked)
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe, 0o600)
    assert "is a pipe, expected a file" in failure(pipe)
    assert "is a pipe, expected a file" in failure(found, pipe)
    assert "is a device, expected a file" in failure(Path("/dev/zero"), key)


def test_a_kept_certificate_that_others_may_read_is_not_used(opened: Open, state: Path) -> None:
    opened()
    state.chmod(0o644)
    with pytest.raises(VsenseError, match=r"page\.pem: others may read .* chmod 600"):
        _certificate.tls_of(OPEN)


def test_where_it_cannot_be_kept(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for base in (tmp_path / "file", tmp_path / ("long" * 100)):
        monkeypatch.setenv("XDG_STATE_HOME", str(base))
        with pytest.raises(VsenseError, match="cannot keep the page's certificate; or give one"):
            _certificate.tls_of(OPEN)


# -- what is asked for ----------------------------------------------------------------------


def test_without_the_library_nothing_starts(monkeypatch: pytest.MonkeyPatch) -> None:
    found = importlib.util.find_spec
    hidden = lambda name: None if name == "cryptography" else found(name)  # noqa: E731
    monkeypatch.setattr(importlib.util, "find_spec", hidden)
    with pytest.raises(UsageError) as caught:
        page_access(OPEN)
    assert re.fullmatch(
        "a page that other machines may open needs the Python package cryptography:"
        r" .*pip install 'cryptography>=[0-9.]+'; or give one with --web-cert FILE, or send the"
        " tokens unencrypted with --insecure",
        str(caught.value),
    )
    assert _certificate.tls_of(WebAddress("127.0.0.1", 0)) is None


def test_insecure_is_plain_http_and_said(opened: Open) -> None:
    page = opened(WebAddress("0.0.0.0", 0, insecure=True))
    assert page.lines[0].startswith("control room: http://")
    assert page.lines[2].startswith("not encrypted: the page's tokens go over plain HTTP")
    answer = curl(f"http://127.0.0.1:{page.port}/{page.query}")
    assert answer.startswith("HTTP/1.1 200") and "Secure" not in answer


def test_this_machine_needs_none() -> None:
    for host in ("127.0.0.1", "localhost", "::1"):
        assert _certificate.tls_of(WebAddress(host, 0)) is None
        assert page_access(WebAddress(host, 0)).warnings() == []


def test_the_options(tmp_path: Path) -> None:
    words = ["replay", "a.mcap", "--web", "0.0.0.0:1", "--web-cert", "c", "--web-key", "k"]
    options = parser(words).parse_args(words)
    assert web_of(options) == WebAddress("0.0.0.0", 1, None, Path("c"), Path("k"), False)
    for command in (["run", "x"], ["lab", "x"], ["track", "r", "x"], ["cameras", "show", "c"]):
        words = [*command, "--web", "0.0.0.0:1", "--insecure"]
        found = web_of(parser(words).parse_args(words))
        assert found is not None and found.insecure
    words = ["replay", "a.mcap", "--web-key", "k"]
    with pytest.raises(UsageError, match="--web-key is the key of a certificate"):
        web_of(parser(words).parse_args(words))
