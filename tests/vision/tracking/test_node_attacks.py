"""What others on the network may say to a tracker with nodes, and what becomes of it."""

from __future__ import annotations

import json
import re
import subprocess
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import require_tool
from tests.rigs.nodes import PERIOD_NS, RunningNode, Watched, central_file, draw
from tests.rigs.places import ROOT
from tests.rigs.processes import free_port
from vsense.base.errors import VsenseError
from vsense.vision.tracking._node_rows import Expectation, encode_expectation
from vsense.vision.tracking._prediction import KNOWN

zenoh = pytest.importorskip("zenoh", reason="pip install vsense[nodes]")
pytestmark = pytest.mark.paced

PAGE = ROOT / "vsense" / "vision" / "tracking" / "NODES.md"
PROGRAM = ("-m", "tests.rigs.playing_node")
WORDS = ("--keep", "--period", str(1e-9 * PERIOD_NS))


class Scene:
    """A tracker with one node, and somebody else on the network who hears all.

    Attributes:
        heard: Rows that the node has said.
    """

    def __init__(self, folder: Path, stack: ExitStack) -> None:
        resources, where = draw(folder), f"tcp/127.0.0.1:{free_port()}"
        central = central_file(resources, where, ("west",), "node")
        node = RunningNode("west", resources, where, *WORDS, program=PROGRAM)
        stack.callback(node.stop)
        self.watched = Watched(central)
        stack.callback(self.watched.close)
        self.watched.wait_whole(4)
        nodes = self.watched.tracking.nodes
        assert nodes is not None
        self.link = nodes.links["west"]
        config = zenoh.Config()
        config.insert_json5("mode", '"client"')
        config.insert_json5("connect/endpoints", f'["{where}"]')
        config.insert_json5("scouting/multicast/enabled", "false")
        self.other = zenoh.open(config)
        stack.callback(self.other.close)
        self.heard: list[bytes] = []
        self._ears = self.other.declare_subscriber(
            "vsense/arena/west/rows", lambda sample: self.heard.append(sample.payload.to_bytes())
        )
        self.watched.wait(lambda: len(self.heard) > 3, "rows")

    def say(self, key: str, data: bytes) -> None:
        self.other.put(f"vsense/arena/{key}", data)

    def refused(self, messages: list[tuple[str, bytes]]) -> list[str]:
        """Says messages one by one; what is refused of them, and the lines about it."""
        watched, lines = self.watched, list[str]()
        for key, data in messages:
            said = len(watched.said)

            def told(begin: int = said) -> list[str]:
                return [text for _, text in watched.said[begin:] if "refused" in text]

            watched.tracking.troubles.counts.clear()  # the first ones of each kind are told
            self.say(key, data)
            watched.wait(lambda: bool(told()), f"{key} {data[:40]!r}")
            lines += told()
        steps = len(watched.steps)
        watched.wait(lambda: len(watched.steps) > steps + 5, "timesteps")
        watched.wait_whole(4)
        return lines


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Scene]:
    with ExitStack() as stack:
        yield Scene(tmp_path_factory.mktemp("scene"), stack)


def test_a_node_that_nobody_has_listed_gives_nothing(scene: Scene) -> None:
    token = scene.other.liveliness().declare_token("vsense/arena/thief/here/1")
    for data in scene.heard[-3:]:
        scene.say("thief/rows", data)
    line = "node thief is there, and no <grabber> names it"
    scene.watched.wait(lambda: any(line in text for _, text in scene.watched.said), line)
    token.undeclare()
    scene.watched.wait_whole(4)
    assert {c for s in scene.watched.steps for c in s.captures_ns} == {f"cam_{n}" for n in range(4)}


def test_two_nodes_of_one_name_are_told_and_neither_is_asked(scene: Scene) -> None:
    """By default a node is called as its computer, and many are called alike."""
    watched, line = scene.watched, "2 nodes are called west, expected one"
    said = len(watched.said)
    token = scene.other.liveliness().declare_token("vsense/arena/west/here/1")
    watched.wait(lambda: any(line in text for _, text in watched.said[said:]), line)
    watched.wait_whole(4)
    with pytest.raises(VsenseError, match=line):
        scene.link.check_name()
    token.undeclare()
    watched.wait(lambda: len(scene.link._here) == 1, "its end")
    scene.link.check_name()


def test_a_flood_of_questions_does_not_keep_a_node_from_its_work(scene: Scene) -> None:
    def answers(part: str, question: bytes) -> set[str]:
        flood = [scene.other.get(f"vsense/arena/west/{part}", payload=question, timeout=30.0)
                 for _ in range(2000)]  # fmt: skip
        return {reply.err.payload.to_string() for replies in flood for reply in replies}

    assert "is asked too much at once" in answers("open", b"x")
    assert all("session" in text or "too much" in text for text in answers("read", b"[1, 0, 0]"))
    steps = len(scene.watched.steps)
    scene.watched.wait(lambda: len(scene.watched.steps) > steps + 5, "timesteps")
    scene.watched.wait_whole(4)


def test_garbage_and_other_versions_are_refused_and_cost_nothing_else(scene: Scene) -> None:
    good = scene.heard[-1]
    lines = scene.refused(
        [
            ("west/rows", b""),
            ("west/rows", b"\0" * 100_000),
            ("west/rows", good[: len(good) // 2]),
            ("west/rows", good[:4] + b"\2\0" + good[6:]),
            ("west/events", b"\xff" * 1000),
            ("west/preview/99", b"x"),
            ("west/preview/00009999", b"x"),
            ("west/preview/0", b"x" * 1000),
        ]
    )
    assert any("format 2, this is 1" in line for line in lines) and len(lines) == 8


def test_events_count_of_its_session_its_cameras_and_kinds_that_nodes_have(scene: Scene) -> None:
    def event(session: int, camera: int, kind: str, text: str = "zebra") -> tuple[str, bytes]:
        return "west/events", json.dumps([session, [[camera, kind, text]]]).encode()

    own, said = scene.link.session, len(scene.watched.said)
    others = [(0, 0, "dark"), (own + 1, 0, "dark"), (own, 4, "dark"), (own, 0, "refused")]
    assert len(scene.refused([event(*other) for other in others])) == 4

    def told() -> list[str]:
        return [text for _, text in scene.watched.said[said:] if "zebra" in text]

    assert told() == []
    scene.say(*event(own, 3, "gone", "zebra " * 1000))
    scene.watched.wait(lambda: bool(told()), "an event")
    (text,) = told()
    assert "cam_3" in text and len(text) < 1000, "and no text is longer than messages are"


def test_expectations_that_no_tracker_has_do_not_end_a_node(scene: Scene) -> None:
    """It looked for them, and ended: all its cameras were gone."""
    nobody, nowhere = np.zeros(0, dtype=KNOWN), np.zeros(0)
    for offset_ns, joined in ((-(2**63), []), (0, [(0, -5, 0.06)]), (0, [(0, 70_000, 0.06)])):
        about = (scene.link.session, 10**9, 1, 0, offset_ns, True, None)
        data = encode_expectation(Expectation(*about, nobody, nowhere, {}, joined))
        scene.say("west/expect", data)
    steps = len(scene.watched.steps)
    scene.watched.wait(lambda: len(scene.watched.steps) > steps + 20, "timesteps")
    scene.watched.wait_whole(4)


def test_an_events_text_is_one_line_that_controls_nothing(scene: Scene) -> None:
    said, forged = len(scene.watched.said), "zebra\n12:00:00 ROBOT 31 does NOT stop\x1b[2J"
    event = json.dumps([scene.link.session, [[3, "gone", forged]]]).encode()
    scene.say("west/events", event)
    lines: list[str] = []

    def told() -> bool:
        lines[:] = [text for _, text in scene.watched.said[said:] if "zebra" in text]
        return bool(lines)

    scene.watched.wait(told, "an event")
    assert "\n" not in lines[0] and "\x1b" not in lines[0] and r"\x1b[2J" in lines[0]


def test_rows_that_were_heard_count_once(scene: Scene) -> None:
    steps = len(scene.watched.steps)
    lines = scene.refused([("west/rows", data) for data in scene.heard[-4:-1]])
    assert any("rows that came before" in line for line in lines)
    captures = [s.capture_ns for s in scene.watched.steps[steps:]]
    assert captures == sorted(captures), "no timestep a second time"


def test_rows_of_other_times_and_sessions_are_refused(scene: Scene) -> None:
    good = bytearray(scene.heard[-1])
    later = good.copy()
    later[16:24] = (1 << 40).to_bytes(8, "little")  # a number that the node has not come to
    # A second head: camera, full, and then the capture time of the first picture.
    future, stranger = later.copy(), good.copy()
    capture_ns = int.from_bytes(good[59:67], "little")
    future[59:67] = (capture_ns + 60_000_000_000).to_bytes(8, "little")
    stranger[8:16] = (12345).to_bytes(8, "little")
    lines = scene.refused([("west/rows", bytes(data)) for data in (future, stranger)])
    assert any("was taken +" in line for line in lines)
    assert any("another session" in line for line in lines)


def test_the_pages_certificates_let_the_labs_nodes_in_and_nobody_else(tmp_path: Path) -> None:
    """Runs the commands of the page, and takes the two configurations that it shows."""
    require_tool("openssl", "openssl")
    page = PAGE.read_text()
    commands = re.findall(r"^```sh\n(openssl.*?)^```", page, re.M | re.S)
    configs = re.findall(r"^```json5\n(.*?)^```", page, re.M | re.S)
    assert len(commands) == 1 and len(configs) == 2
    shell = commands[0].replace("10.0.0.2", "127.0.0.1")
    subprocess.run(["sh", "-ec", shell], cwd=tmp_path, check=True, capture_output=True)
    resources, port = draw(tmp_path), free_port()
    for name, text in zip(("tracker", "west"), configs, strict=True):
        (tmp_path / f"{name}.json5").write_text(text.replace("/etc/vsense", str(tmp_path)))
    config, where = (tmp_path / "west.json5").read_text(), f"tls/127.0.0.1:{port}"
    (tmp_path / "east.json5").write_text(config.replace("west.", "east."))
    subprocess.run(
        [
            "sh",
            "-ec",
            shell.replace("-CA ca.pem -CAkey ca.key", "-CA own.pem -CAkey own.key")
            .replace("ca.key", "own.key")
            .replace("ca.pem", "own.pem"),
        ],
        cwd=_beside(tmp_path),
        check=True,
        capture_output=True,
    )
    thief = config.replace(f"{tmp_path}/west", f"{tmp_path}/beside/west")
    (tmp_path / "thief.json5").write_text(thief)
    central = central_file(resources, where, ("west",), "node")
    central.write_text(central.read_text().replace("<nodes ", '<nodes config="tracker.json5" '))
    with ExitStack() as stack:
        for file in ("thief", "east", "west"):
            # All of them say that they are west; the second has the certificate of another node.
            words = (*WORDS, "--config", str(tmp_path / f"{file}.json5"))
            node = RunningNode("west", resources, where, *words, program=PROGRAM)
            stack.callback(node.stop)
            if file == "thief":
                watched = Watched(central)
                stack.callback(watched.close)
                node.wait_for("reaches nobody yet")
            if file == "east":
                time.sleep(1.0)
            if file != "west":
                assert watched.steps == []
        watched.wait_whole(4)


def _beside(folder: Path) -> Path:
    """A folder in which the same commands make certificates of somebody else's."""
    (folder / "beside").mkdir()
    return folder / "beside"
