"""Users' code that searches its own process for the swarm's key: memory, what is open, files.

Its C, in a robot's daemon and in a virtual robot beside the server, its loop functions and its
sensor do. Each finds a canary, so each would find a key: the robot's process that robot's own.
What a lab shows to all, and leaves behind, is searched, too.
"""

from __future__ import annotations

import base64
import hashlib
import os
import re
import shutil
import signal
import stat
import subprocess
import sys
import urllib.request
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from urllib.error import HTTPError

import pytest
from mcap.stream_reader import StreamReader

from tests.rigs.processes import Lab, descendants, free_port
from tests.system.key_search.memory_search import CANARY, masked
from vsense.robots.link import keys
from vsense.robots.link.keys import SwarmKeys

pytestmark = [pytest.mark.system, pytest.mark.paced]

CODE = Path(__file__).parent / "key_search"
TAGS = (31, 1843)
KNOWN = hashlib.sha256(b"the swarm's key").digest()
DRAW = """
import hashlib, secrets
draw = secrets.token_bytes
secrets.token_bytes = lambda size=None: (
    hashlib.sha256(b"the swarm's key").digest() if size == 32 else draw(size)
)
"""
"""A lab draws its key itself: this makes it a known one, which nobody has who does not draw it."""

VSENSE = (sys.executable, "-m", "vsense")


def write(folder: Path) -> Path:
    """The experiment in a folder, with all that it looks for."""
    here = folder / "experiment"
    shutil.copytree(CODE, here, ignore=shutil.ignore_patterns("__pycache__"))
    swarm, report = SwarmKeys({1: KNOWN}), here / "report"
    uids = [hashlib.sha256(f"vsense lab robot {tag}".encode()).digest()[:16] for tag in TAGS]
    needles = {
        "swarm": KNOWN,
        "text": KNOWN.hex().encode(),
        "first": swarm.robot_key(uids[0]),
        "second": swarm.robot_key(uids[1]),
        "canary": CANARY,
    }
    hidden = {name: masked(needle).hex() for name, needle in needles.items()}
    (here / "search.json").write_text(
        f'{{"needles": {hidden}, "report": "{report}", "folder": "{folder}"}}'.replace("'", '"')
    )
    file = here / "searching.argos"
    words = " ".join(f'{name}="{text}"' for name, text in hidden.items())
    file.write_text(file.read_text().replace("REPORT", str(report)).replace("NEEDLES", words))
    return file


def finds(file: Path) -> list[tuple[str, int, dict[str, int], str]]:
    """What was found: by whom, in which process, how often, and in which files."""
    rows = []
    for line in (file.parent / "report").read_text().splitlines():
        who, pid, *words = line.split()
        files = words[words.index("files") + 1] if "files" in words else "-"
        counts = {
            name: int(count) for name, count in zip(words[::2], words[1::2]) if name != "files"
        }
        rows.append((who, int(pid), counts, files))
    return rows


def check(file: Path, host: int | None, in_files: str) -> None:
    """Nobody has found the swarm's key, and everybody what is there."""
    rows = finds(file)
    assert sorted(who for who, *_ in rows) == ["controller"] * 3 + ["loop", "sensor"], rows
    for who, _, counts, files in rows:
        assert counts["canary"] and counts["canary"] < 9999, rows
        assert counts["swarm"] == counts["text"] == 0, rows
        assert files == (in_files if who != "controller" else "-"), rows
    (server,) = {pid for who, pid, *_ in rows if who != "controller"}
    assert host in (None, server)
    robots = [counts for who, pid, counts, _ in rows if who == "controller" and pid != server]
    assert len(robots) == 2, "the third is the virtual one's, beside the server"
    # The known key was the swarm's: the keys made of it are where they have to be, and only there.
    assert sorted((bool(r["first"]), bool(r["second"])) for r in robots) == [
        (False, True),
        (True, False),
    ], rows


def test_in_a_lab_no_code_of_users_finds_the_swarms_key(tmp_path: Path) -> None:
    (tmp_path / "start").mkdir()
    (tmp_path / "start" / "sitecustomize.py").write_text(DRAW)
    file = write(tmp_path)
    path = os.pathsep.join([str(tmp_path / "start"), os.environ.get("PYTHONPATH", "")])
    command = [*VSENSE, "lab", str(file), "--port", "0", "-o", str(tmp_path / "run")]
    lab = subprocess.Popen(
        command, env=os.environ | {"PYTHONPATH": path}, stderr=subprocess.PIPE, text=True
    )
    said = lab.communicate(timeout=60)[1]
    # To search takes seconds: timesteps are left out, and the run may be invalid.
    assert lab.returncode in (0, 1), said
    check(file, lab.pid, "-")


def forms(key: bytes) -> list[bytes]:
    """How a key may be written."""
    return [key, key.hex().encode(), base64.b64encode(key)]


def shown(lab: Lab) -> Iterator[tuple[str, bytes]]:
    """What other programs see of a lab's processes; that of the keys shows its environment to root
    alone."""
    for pid in (lab.process.pid, *descendants(lab.process.pid)):
        for name in ("cmdline", "environ"):
            with suppress(PermissionError, FileNotFoundError, ProcessLookupError):
                yield f"{name} of {pid}", Path(f"/proc/{pid}/{name}").read_bytes()


def left(folder: Path) -> Iterator[tuple[str, bytes]]:
    """The files of a folder; of a recording what its chunks hold, too."""
    for path in sorted(path for path in folder.rglob("*") if path.is_file()):
        yield path.name, path.read_bytes()
        if path.suffix == ".mcap":
            with path.open("rb") as file:
                for number, record in enumerate(StreamReader(file).records):
                    data = getattr(record, "data", b"")
                    yield f"record {number} of {path.name}", data + repr(record).encode()


def test_keys_and_tokens_are_in_private_files_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "sitecustomize.py").write_text(DRAW)
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}:{os.environ.get('PYTHONPATH', '')}")
    tokens, swarm = tmp_path / "tokens", SwarmKeys({1: KNOWN})
    tokens.touch(mode=0o600)
    tokens.write_text("look=a-token-that-looks\ncontrol=a-token-that-controls\n")
    words = ["--robots", "2", "--record", "--web", "0", "--web-tokens", str(tokens), "--port", "0"]
    lab = Lab(tmp_path / "run", "pollutant", *words, "--duration", "600", "--json")
    needles = [*forms(KNOWN), b"a-token-that"]
    try:
        lab.wait_for("  timestep ")
        address = re.findall(r"http://\S+:\d+", "".join(lab.said))[0]
        for end in ("controls", "looks"):
            urllib.request.urlopen(f"{address}/?token=a-token-that-{end}", timeout=20).close()
        with pytest.raises(HTTPError, match="403"):
            urllib.request.urlopen(f"{address}/?token=a-token-that-does-not-count", timeout=20)
        files = sorted((tmp_path / "run").rglob("*.key"))
        assert len(files) == 2
        for file in files:
            (uid,) = re.findall("uid = (.*)", text := file.read_text())
            key = swarm.robot_key(bytes.fromhex(uid))
            assert key.hex() in text and stat.S_IMODE(file.stat().st_mode) == 0o600
            needles += forms(key)
        seen = dict(shown(lab))
        assert f"environ of {lab.process.pid}" in seen
        lab.process.send_signal(signal.SIGINT)
        assert lab.end() == 130
    finally:
        lab.process.kill()
    seen |= dict(left(tmp_path / "run")) | {"summary": "".join(lab.printed).encode()}
    assert len(seen) > 20 and any(name.startswith("record ") for name in seen)
    # Its own terminal has the page's two addresses, with the tokens, and no other line has them.
    said = "".join(lab.said)
    for role, end in (("", "controls"), (", to look only", "looks")):
        line = f"control room{role}: {address}/?token=a-token-that-{end}\n"
        assert line in said
        said = said.replace(line, "")
    seen["what it said"] = said.encode()
    assert [name for name, data in seen.items() if any(n in data for n in needles)] == []


def test_in_a_run_no_code_of_users_finds_the_swarms_key(tmp_path: Path) -> None:
    """But in the one file that is the user's own."""
    file, own = write(tmp_path), tmp_path / "keys" / "swarm.key"
    keys.write(own, SwarmKeys({1: KNOWN}))
    port, lines = free_port(), free_port()
    who = ["--key", str(own), "--port", str(port)]
    emulate = [
        *VSENSE,
        "robot",
        "emulate",
        "--experiment",
        str(file),
        "--tracker-port",
        str(lines),
        *who,
    ]
    with (tmp_path / "said").open("w") as said:
        robots = subprocess.Popen(emulate, stderr=said, start_new_session=True)
    try:
        run = [*VSENSE, "run", str(file), "--tracker", f"lines:{lines}", *who, "--duration", "2"]
        done = subprocess.run(
            [*run, "-o", str(tmp_path / "run")], capture_output=True, text=True, timeout=60
        )
        # To search takes seconds: timesteps are left out, and the run may be invalid.
        assert done.returncode in (0, 1), done.stderr + (tmp_path / "said").read_text()
        robots.send_signal(signal.SIGINT)
        assert robots.wait(20) == 130
    finally:
        robots.kill()
        robots.wait()
    check(file, None, own.name)
