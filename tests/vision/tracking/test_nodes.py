"""Recordings on several computers: real processes, and every bit as on one."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack, suppress
from pathlib import Path
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest

from tests.rigs.nodes import PATIENCE_S, RunningNode, central_file, tracked
from tests.rigs.processes import free_port
from tests.vision.tracking.synthetic import Look, Robot, render
from vsense.base.clock import host_ns
from vsense.base.errors import ConfigError, NoMorePictures, UsageError, VsenseError
from vsense.config import tracking_session
from vsense.modes.live._sources import doubt_of_nodes
from vsense.vision.cameras.camera import Camera
from vsense.vision.markers.families import load_family
from vsense.vision.tracking import node_session
from vsense.vision.tracking.node_session import NodeNetwork, open_network
from vsense.vision.tracking.opening import open_tracking

pytest.importorskip("zenoh", reason="pip install vsense[nodes]")

TIMESTEPS, SIZE = 16, (600, 480)
CAMERAS = [
    Camera.looking_down(f"cam_{n}", x, 0.0, 2.4, 1600.0, SIZE)
    for n, x in enumerate((-0.75, -0.25, 0.25, 0.75))
]
NODES = ("west", "east")
JOINS, UNREAD, LOST = 12_684, 9, 4
"""A tag on no roster; timesteps of a damaged picture of camera 1, and of none of camera 2."""


def robots(timestep: int) -> list[Robot]:
    way = 0.012 * timestep
    return [
        Robot(31, -0.9 + way, 0.1, 0.0),
        Robot(700, 0.5 - way, -0.1, 3.1),
        Robot(JOINS, -0.1, 0.15, 1.6),
    ]


Files = Callable[[int], tuple[Path, Path]]


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Files:
    folder = tmp_path_factory.mktemp("rig")
    family, generator = load_family("arrow4x4"), np.random.default_rng(1)
    for number, camera in enumerate(CAMERAS):
        (folder / camera.id).mkdir()
        (folder / f"{camera.id}.json").write_text(camera.to_json())
        for k in range(TIMESTEPS):
            image = render(camera, family, robots(k), Look(litter=5, noise=0.0), 1, 0.06)
            noisy = image + generator.normal(0.0, 2.0, image.shape)
            data = cv2.imencode(".png", np.clip(noisy, 0, 255).astype(np.uint8))[1].tobytes()
            if (number, k) == (1, UNREAD):
                data = data[: len(data) // 2]
            if (number, k) != (2, LOST):
                (folder / camera.id / f"{k}.png").write_bytes(data)
    grabbers = (f'<grabber id="{c.id}" type="directory" path="{c.id}" />' for c in CAMERAS)
    cameras = (f'<camera id="{c.id}" calibration="{c.id}.json" />' for c in CAMERAS)
    views = (
        f'<camera_state_tracker grabber="{c.id}" camera="{c.id}" tracker="t" />' for c in CAMERAS
    )
    (folder / "resources.xml").write_text(
        f"<arena_tracking_system>\n<grabbers>{' '.join(grabbers)}</grabbers>\n<trackers>"
        '<tracker id="t" family="arrow4x4" tags="31 700" /></trackers>\n'
        f"<cameras>{''.join(cameras)}</cameras></arena_tracking_system>"
    )
    body = "".join(views)

    def written(period: int) -> tuple[Path, Path]:
        (folder / "experiment.xml").write_text(
            f'<arena_tracking><arena_state_tracker opt_key_frame_period="{period}"'
            f' opt_square_size="11">{body}</arena_state_tracker></arena_tracking>'
        )
        return folder / "resources.xml", folder / "experiment.xml"

    return written


def test_a_recording_on_two_nodes_gives_every_bit_of_one_computer(files: Files) -> None:
    resources, experiment = files(3)
    where, told, expected_told = f"tcp/127.0.0.1:{free_port()}", [], []
    expected = tracked(resources, experiment, expected_told)
    central = central_file(resources, where, NODES, "node_recording")
    text = central.read_text().replace("<nodes ", '<nodes arena="lab" config="zenoh.json5" ')
    central.write_text(text)
    config = resources.with_name("zenoh.json5")
    config.write_text("{ transport: { link: { tx: { threads: 1 } } } }")
    with ExitStack() as stack:
        for name in NODES:
            words = ("--arena", "lab", "--config", str(config))
            stack.callback(RunningNode(name, resources, where, *words).stop)
        states = tracked(central, experiment, told)
    assert states == expected and len(states) == TIMESTEPS
    assert max(len(state[5]) for state in states) == 1, "a robot has joined the roster"
    assert any("cut off" in line for line in told) and len(told) == 2 + len(expected_told)


def test_coarse_pictures_are_not_recorded(files: Files) -> None:
    resources, experiment = files(3)
    where = f"tcp/127.0.0.1:{free_port()}"
    central = central_file(resources, where, NODES, "node_recording")
    own = ElementTree.parse(resources).findall("grabbers/grabber")[0]
    tree = ElementTree.parse(central)
    tree.findall("grabbers/grabber")[0].attrib = own.attrib
    tree.write(central)
    recorded, seen = set[str](), set[str]()
    with ExitStack() as stack:
        for name in NODES:
            stack.callback(RunningNode(name, resources, where).stop)
        tracking = open_tracking(tracking_session.load(central, experiment), host_ns, print)
        stack.callback(tracking.close)
        tracking.record = lambda frames: recorded.update(frame.camera for frame in frames)
        with suppress(NoMorePictures):
            while True:
                seen |= {frame.camera for frame in tracking.next(PATIENCE_S)[1]}
    assert recorded == {own.get("id")} and seen == {camera.id for camera in CAMERAS}


def opened(resources: Path, experiment: Path) -> None:
    session = tracking_session.load(resources, experiment)
    open_tracking(session, host_ns, lambda text: None).close()


def test_what_a_node_does_not_have_is_named(files: Files) -> None:
    resources, experiment = files(1)
    where = f"tcp/127.0.0.1:{free_port()}"
    central = central_file(resources, where, ("west",), "node_recording")
    central.write_text(central.read_text().replace("<grabber ", '<grabber grabber="cam" ', 1))
    node = RunningNode("west", resources, where)
    try:
        with pytest.raises(ConfigError, match=r"central\.xml:2: .*node west: has no <grabber>"):
            opened(central, experiment)
    finally:
        assert node.stop() == 143


def test_a_tracker_that_was_killed_is_followed_by_another(files: Files) -> None:
    """The node keeps its tracker for two seconds: it may only be cut off."""
    resources, experiment = files(1)
    where = f"tcp/127.0.0.1:{free_port()}"
    central = central_file(resources, where, ("west",), "node_recording")
    node = RunningNode("west", resources, where)
    try:
        session = tracking_session.load(central, experiment)
        killed = open_tracking(session, host_ns, lambda text: None)
        assert killed.nodes is not None
        killed.nodes._zenoh.close()
        opened(central, experiment)
    finally:
        node.stop()


def test_a_port_that_another_has_ends_the_start(files: Files) -> None:
    import zenoh

    resources, experiment = files(1)
    where = f"tcp/127.0.0.1:{free_port()}"
    config = zenoh.Config()
    config.insert_json5("listen/endpoints", f'["{where}"]')
    with zenoh.open(config):
        central = central_file(resources, where, NODES, "node")
        with pytest.raises(VsenseError, match=f"{where}: Zenoh does not begin: .*in use"):
            opened(central, experiment)


def test_trackers_and_nodes_meet_at_a_router(files: Files, monkeypatch: pytest.MonkeyPatch) -> None:
    import zenoh

    resources, experiment = files(1)
    where = f"tcp/127.0.0.1:{free_port()}"
    central = central_file(resources, where, ("west",), "node_recording")
    central.write_text(central.read_text().replace("<nodes listen", "<nodes connect"))
    monkeypatch.setattr(node_session, "ROUTER_MS", 100)
    with pytest.raises(VsenseError, match=f"{where}: Zenoh does not begin: Unable to connect"):
        opened(central, experiment)
    config = zenoh.Config()
    config.insert_json5("mode", '"router"')
    config.insert_json5("listen/endpoints", f'["{where}"]')
    with zenoh.open(config):
        node = RunningNode("west", resources, where)
        try:
            assert len(tracked(central, experiment, [])) == TIMESTEPS
        finally:
            node.stop()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("x{", "zenoh.json5: no configuration of Zenoh's: --> 1:1"),
        ("{ transport: { link: { tls: { connect_certificate: '/none.pem' } } } }",
         "zenoh.json5: connect_certificate: /none.pem: No such file"),
        ("{ transport: { link: { tls: { listen_private_key: '/dev/null' } } } }",
         "zenoh.json5: listen_private_key: /dev/null: is a device, expected a file"),
    ],
)  # fmt: skip
def test_configurations_that_cannot_be_are_told(tmp_path: Path, text: str, words: str) -> None:
    config = tmp_path / "zenoh.json5"
    config.write_text(text)
    with pytest.raises(UsageError) as caught:
        open_network(NodeNetwork((), ("tls/127.0.0.1:7447",), config))
    assert words in str(caught.value) and "\n" not in str(caught.value)
    with pytest.raises(UsageError, match=r"/dev/null: .* is a device, expected a file"):
        open_network(NodeNetwork((), ("tls/127.0.0.1:7447",), Path("/dev/null")))


@pytest.mark.parametrize(
    ("where", "doubts"),
    [("tcp/0.0.0.0:7447", 1), ("tcp/127.0.0.1:7447", 0), ("tls/0.0.0.0:7447", 0)],
)
def test_who_could_be_a_node_is_said(files: Files, where: str, doubts: int) -> None:
    resources, experiment = files(1)
    session = tracking_session.load(central_file(resources, where, NODES, "node"), experiment)
    assert bool(doubt_of_nodes(session)) == bool(doubts)
    assert doubt_of_nodes(tracking_session.load(resources, experiment)) == ""


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        ("tcp/127", "tpc/127", r":3: <nodes> listen: 'tpc/127.*expected such as tcp/10"),
        ("<nodes ", '<nodes arena="a/b" ', ":3: <nodes> arena: 'a/b' is no name"),
        ('node="west"', "", ":2: <grabber> node: is missing"),
        (' frame_rate="10"', "", ":2: <grabber> frame_rate: is missing"),
        ("<nodes listen", "<knots listen", "knots"),
    ],
)
def test_mistakes_are_named(files: Files, before: str, after: str, words: str) -> None:
    resources, experiment = files(1)
    central = central_file(resources, "tcp/127.0.0.1:7447", NODES, "node")
    central.write_text(central.read_text().replace(before, after))
    with pytest.raises((ConfigError, UsageError), match=words):
        opened(central, experiment)
