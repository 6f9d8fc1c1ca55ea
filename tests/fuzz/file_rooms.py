"""Rooms of files that people write: experiments, tracking sessions, cameras, marker families, lists
of robots, keys and tokens, tables, learnt policies."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from random import Random

import numpy as np

from tests.fuzz import mutate
from vsense.config import battery_history, experiment, placement, roster, tracking_session
from vsense.config import resources as resources_file
from vsense.config.description import describe
from vsense.monitor.ui.access import read_tokens
from vsense.robots import key_holders
from vsense.robots._policy_graph import Op
from vsense.robots.link import keys
from vsense.robots.policy import PolicyError, read_policy
from vsense.studies.series import _plan
from vsense.vision.calibration._views import read_corners
from vsense.vision.calibration.foreign import read_foreign
from vsense.vision.cameras._recordings import read_timestamps
from vsense.vision.cameras.camera import Camera, CameraError
from vsense.vision.markers.families import MarkerFamily, known_families, load_family
from vsense.vision.tracking._kernel import Kernel

HERE = Path(__file__).resolve().parent
SHIPPED = resources.files("vsense")


def prepare_argos(folder: Path) -> list[tuple[Path, bytes]]:
    """The shipped experiments, and those of the tests that use every element."""
    shipped = Path(str(SHIPPED / "config" / "experiments"))
    paths = [*sorted(shipped.glob("*.argos")), *sorted((HERE.parent / "config").glob("*.argos"))]
    return [(path, path.read_bytes()) for path in paths]


def argos(random: Random, scene: list[tuple[Path, bytes]]) -> None:
    """An experiment is read, described, and its robots are placed."""
    path, data = random.choice(scene)
    settings = None
    if random.random() < 0.1:
        name = mutate.text(
            random, random.choice(("light.intensity", "epuck.x", "framework.length"))
        )
        settings = {name: random.choice(mutate.NUMBERS)}
    stage = random.choice(list(experiment.Stage))
    found = experiment.read(
        mutate.xml(random, data), path.name, path, None, settings, stage, random.random() < 0.5
    )
    assert describe(found)
    placed = placement.settle(found, random.randrange(100))
    poses = np.array([robot.pose for robot in placed.robots], dtype=float)
    assert np.isfinite(poses).all()


@dataclass(frozen=True, slots=True)
class SessionScene:
    """A folder with what the files of a tracking session refer to."""

    folder: Path
    resources: bytes
    session: bytes


def prepare_session(folder: Path) -> SessionScene:
    """The shipped examples, with the files that they name."""
    examples = Path(str(SHIPPED / "config" / "examples"))
    camera = Camera.looking_down("any", 0.0, 0.0, 2.0, 800.0, (640, 480)).to_json()
    for path in sorted(examples.glob("*.xml")):
        (folder / path.name).write_bytes(path.read_bytes())
    for word in set(_named(folder)):
        target = folder / word
        target.parent.mkdir(parents=True, exist_ok=True)
        if word.endswith(".json"):
            target.write_text(camera)
        elif word.endswith(".csv"):
            target.write_text("capture_s\n0.1\n0.2\n")
        elif "." in Path(word).name:
            target.write_bytes(b"")
        else:
            target.mkdir(exist_ok=True)
    texts = {path.name: path.read_bytes() for path in folder.glob("*.xml")}
    first = next(data for data in texts.values() if b"<arena_tracking_system" in data)
    second = next(
        data
        for data in texts.values()
        if b"<arena_tracking " in data or b"<arena_tracking>" in data
    )
    return SessionScene(folder, first, second)


def _named(folder: Path) -> list[str]:
    """Relative paths in the examples' attributes."""
    from xml.etree import ElementTree

    found = []
    for path in folder.glob("*.xml"):
        for element in ElementTree.parse(path).iter():
            for key in ("calibration", "path", "timestamps", "family"):
                word = element.get(key, "")
                if word and not word.startswith("/") and word not in known_families():
                    found.append(word)
    return found


def session(random: Random, scene: SessionScene) -> None:
    """The two files of a tracking session."""
    first, second = scene.resources, scene.session
    if random.random() < 0.5:
        first = mutate.xml(random, first)
    else:
        second = mutate.xml(random, second)
    found = resources_file.read(first, "resources.xml", scene.folder)
    tracking_session.read(second, "session.xml", scene.folder, found)


def prepare_camera(folder: Path) -> dict[str, object]:
    """A camera file's values."""
    values = json.loads(Camera.looking_down("left", 0.1, 0.2, 2.0, 800.0, (640, 480)).to_json())
    assert isinstance(values, dict)
    return values


def camera(random: Random, values: dict[str, object]) -> None:
    """A camera file: what is taken is the camera that is written, and made of numbers."""
    try:
        found = Camera.from_json(mutate.as_json(random, values))
    except CameraError:
        return
    assert Camera.from_json(found.to_json()) == found
    numbers = (found.fx_px, found.fy_px, found.cx_px, found.cy_px, *found.distortion)
    assert np.isfinite((*numbers, *found.rotation, *found.position_m)).all()
    assert found.width_px > 0 and found.height_px > 0


@dataclass(frozen=True, slots=True)
class FamilyScene:
    """All shipped marker families, and where a changed one is written."""

    values: list[dict[str, object]]
    path: Path


def prepare_family(folder: Path) -> FamilyScene:
    """See `FamilyScene`."""
    shipped = sorted(Path(str(SHIPPED / "vision" / "markers" / "families")).glob("*.json"))
    return FamilyScene([json.loads(path.read_text()) for path in shipped], folder / "mine.json")


def family(random: Random, scene: FamilyScene) -> None:
    """A marker family: what is taken, the picture kernel takes, too."""
    data = mutate.as_json(random, random.choice(scene.values)).encode("utf-8", "surrogatepass")
    scene.path.write_bytes(mutate.raw(random, data) if random.random() < 0.1 else data)
    found = load_family(str(scene.path))
    if not isinstance(found, MarkerFamily):
        return
    assert np.isfinite(found.polygon_mm).all()
    kernel = Kernel(found)
    view = Camera.looking_down("any", 0.0, 0.0, 2.0, 800.0, (64, 48))
    kernel.search(np.zeros((48, 64), dtype=np.uint8), view, 0.05)


_LISTS: Mapping[str, tuple[str, Callable[[Path], object]]] = {
    "roster": (
        '# ours\n[defaults]\nbase = "overo"\n[[robot]]\ntag = 23\nhost = "root@192.168.1.30"\n'
        '[robot.calibration]\nwheel_ratio = 1.01\nground_scale = "210:880"\nwhen = 2026-11-23\n'
        "[[robot]]\ntag = 24\nspare = true\nmarker = { x_mm = 1.5, yaw_deg = -2.1 }\n",
        roster.read,
    ),
    "batteries": (
        "time,tag,uid,begin_v,end_v,duration_s\n2026-11-23T10:00:00+01:00,23,,4.1,3.9,60.0\n",
        battery_history.read,
    ),
    "holders": (
        f"# keys\n1 {'ab' * 16} 23 2026-11-23 root@192.168.1.30\n2 {'cd' * 16} 24 2026-11-23 b\n",
        key_holders.read,
    ),
    "plan": (
        'mode = "sim"\nexperiment = "foraging"\nrepetitions = 3\n[settings]\n"a.b" = 1\n'
        '[[condition]]\nname = "x"\nsettings = { "c.d" = "e" }\n[[condition]]\nblind = true\n'
        "[[start]]\nseed = 7\n[[start]]\nposes = [[0.5, -0.5, 90]]\n[void]\nlost_s = 5\n"
        "[robots]\nleast = 2\n",
        lambda path: _plan.read(path).facts(),
    ),
    "keys": (f"# Swarm keys\n2 = {'0f' * 32}\n1 = {'e1' * 32}\n", keys.read),
    "tokens": ("look=a-long-token\ncontrol=another-token\n", read_tokens),
}


def prepare_lists(folder: Path) -> Path:
    """Where a changed file is written."""
    return folder


def lists(random: Random, folder: Path) -> None:
    """Lists of robots, of who holds a key, of keys, of tokens; secrets are in no message."""
    name = random.choice(list(_LISTS))
    source, read = _LISTS[name]
    path = folder / name
    data = mutate.text(random, source).encode("utf-8", "surrogatepass")
    path.write_bytes(mutate.raw(random, data) if random.random() < 0.1 else data)
    path.chmod(0o600)
    try:
        read(path)
    except Exception as error:
        if name in ("keys", "tokens"):
            secret = ("0f0f0f0f", "e1e1e1e1", "a-long-token", "another-token")
            assert not any(word in str(error) for word in secret), "a secret in a message"
        raise


_TABLES: Mapping[str, tuple[str, Callable[[Path], object]]] = {
    "stamps": ("capture_s,timestep\n0.1,1\n0.2,2\n0.35,4\n", lambda p: read_timestamps(p, False)),
    "pictures": (
        "picture,capture_ns\na_1.png,100\na_2.png,200\n",
        lambda path: read_timestamps(path, True),
    ),
    "corners": (
        "camera,moment,corner,x_px,y_px\nleft,1,0,10.5,20.5\nleft,1,1,30.5,20.5\nright,1,0,1,2\n",
        lambda path: read_corners(path, 24),
    ),
    "lens": (
        "%YAML:1.0\n---\nimage_width: 64\nimage_height: 48\ncamera_matrix: !!opencv-matrix\n"
        "   rows: 3\n   data: [ 7., 0., 6., 0.,\n   7., 3.6e+02, 0., 0., 1. ]\n"
        "distortion_coefficients:\n  data:\n  - 0.1\n  - -0.2\n  - 0\n  - 0\n",
        read_foreign,
    ),
}


def prepare_tables(folder: Path) -> Path:
    """Where a changed table is written."""
    return folder


def tables(random: Random, folder: Path) -> None:
    """Tables of capture times and of corners, and lenses of OpenCV and ROS."""
    name = random.choice(list(_TABLES))
    source, read = _TABLES[name]
    path = folder / f"{name}.csv"
    data = mutate.text(random, source).encode("utf-8", "surrogatepass")
    path.write_bytes(mutate.raw(random, data) if random.random() < 0.2 else data)
    read(path)


def prepare_policy(folder: Path) -> tuple[Path, list[bytes]]:
    """Where a changed policy is written, and what exporters have made."""
    made = sorted((HERE.parent / "data" / "policies").glob("*.onnx"))
    return folder / "walk.onnx", [path.read_bytes() for path in made]


def policy(random: Random, scene: tuple[Path, list[bytes]]) -> None:
    """What is read calculates within its memory, whatever a file says."""
    path, sources = scene
    path.write_bytes(mutate.raw(random, random.choice(sources)))
    try:
        found = read_policy(path)
    except PolicyError as error:
        assert str(error).startswith(f"{path}: ")
        raise
    assert found.c_source("walk").count("{VS_POLICY_") == len(found.steps)
    assert found.inputs > 0 and 0 < found.outputs <= found.memory - found.action
    for step in found.steps:
        assert 0 <= step.start <= found.memory - step.inputs
        assert 0 <= step.target <= found.memory - step.outputs
        assert 0 <= step.operand <= found.memory - (step.outputs if step.operand else 0)
        wanted = {Op.DENSE: (step.inputs + 1) * step.outputs, Op.CLIP: 2}
        assert step.weights is None or step.weights.size == wanted.get(step.op, step.outputs)
        assert step.op is Op.DENSE or step.inputs == step.outputs
