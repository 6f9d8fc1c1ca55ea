"""The address of another tracker in an experiment file."""

from __future__ import annotations

import pytest

from vsense.base.errors import ConfigError
from vsense.base.xml.parsing import parse
from vsense.config._framework import read_tracker
from vsense.config.specs import JsonLinesTracker, MocapTracker, TrackerAddress
from vsense.robots.link.trackers.mocap import MocapSystem


def read(
    framework: str = "", engine: str | None = None, inside: str = ""
) -> TrackerAddress | JsonLinesTracker | None:
    engines = f"<physics_engines>\n<iridia_tracking_system {engine}/>\n</physics_engines>"
    text = '<argos-configuration xmlns:vs="urn:vsense:1">\n'
    text += f"<framework {framework}>{inside}</framework>\n{engines if engine else ''}\n"
    root = parse(f"{text}</argos-configuration>".encode(), "x.argos")
    found = read_tracker(root)
    root.child("framework").check_all_read()
    return found


@pytest.mark.parametrize("prefix", ["ats", "its"])
def test_the_thesis_names_it_on_the_framework(prefix: str) -> None:
    found = read(f'{prefix}_host="10.0.0.7" {prefix}_port="4041"')
    assert found == TrackerAddress("10.0.0.7", 4041, (0.0, 0.0), 0.0, 2)


@pytest.mark.parametrize("prefix", ["ats", "its"])
def test_the_code_names_it_on_the_physics_engine(prefix: str) -> None:
    found = read("", f'id="its" {prefix}_host="tracker" translate_x="2.57" translate_y="4.565"')
    assert found == TrackerAddress("tracker", 4040, (2.57, 4.565), 0.0, 4)


def test_the_engine_shifts_the_tracker_that_the_framework_names() -> None:
    found = read('ats_host="a"', 'id="its" translate_x="1"')
    assert found == TrackerAddress("a", 4040, (1.0, 0.0), 0.0, 2)


def test_the_latency_of_its_states_stands_beside_its_host() -> None:
    found = read("", 'id="its" its_host="a" vs:latency="0.04"')
    assert found == TrackerAddress("a", 4040, (0.0, 0.0), 0.04, 4)


def test_any_other_tracker_writes_lines_to_a_port_of_ours() -> None:
    assert read(inside='<vs:tracker format="lines"/>') == JsonLinesTracker("127.0.0.1", 4041, 2)
    words = 'type="vicon" host="10.0.0.5" bodies="red one=23, b=7" up="y" settings="a=1 b=x,y"'
    settings = {"hostname": "10.0.0.5", "a": "1", "b": "x,y"}
    system = MocapSystem("vicon", settings, {"red one": 23, "b": 7}, "y")
    assert read(inside=f'<vs:tracker format="mocap" {words}/>') == MocapTracker(system, 2)
    system = MocapSystem("mock", {"hostname": "127.0.0.1"}, {}, "z")
    assert read(inside='<vs:tracker format="mocap" type="mock"/>') == MocapTracker(system, 2)
    found = read(inside='<vs:tracker format="lines" host="0.0.0.0" port="5000"/>')
    assert found == JsonLinesTracker("0.0.0.0", 5000, 2)


def test_without_a_host_there_is_none() -> None:
    assert read() is None
    assert read("", 'id="its" translate_x="1"') is None


@pytest.mark.parametrize(
    ("framework", "engine", "message"),
    [
        ('vs:latency="0.1"', None, "x.argos:2: <framework> vs:latency:.*ats_host"),
        ('ats_host="a" vs:latency="nan"', None, "vs:latency: 'nan'"),
        ('ats_host="a" vs:latency="2"', None, "vs:latency: 2.*0.*0.3"),
        ('ats_port="4040"', None, "x.argos:2: <framework> ats_port:.*ats_host"),
        ('ats_host="a" its_host="b"', None, "x.argos:2: <framework> its_host:"),
        ('ats_host="a" ats_port="0"', None, "range.*1.*65535"),
        ('ats_host=" "', None, "empty.*host's"),
        ('ats_host="a"', 'its_host="b"', "x.argos:4:.*line 2"),
        ("", 'its_host="b" translate_x="far"', "translate_x: 'far'"),
    ],
)
def test_what_is_wrong_is_refused_at_its_line(
    framework: str, engine: str | None, message: str
) -> None:
    with pytest.raises(ConfigError, match=message):
        read(framework, engine)


@pytest.mark.parametrize(
    ("inside", "message"),
    [
        ("<vs:tracker/>", "x.argos:2: <vs:tracker> format:.*missing"),
        ('<vs:tracker format="udp"/>', "format: 'udp'"),
        ('<vs:tracker format="mocap"/>', "<vs:tracker> type:.*missing, expected one of: vicon"),
        ('<vs:tracker format="mocap" type="kinect"/>', "type: 'kinect' is not one of: vicon"),
        ('<vs:tracker format="mocap" type="mock" port="1"/>', "port:.*attribute"),
        ('<vs:tracker format="mocap" type="mock" up="x"/>', "up: 'x' is not one of: y, z"),
        ('<vs:tracker format="mocap" type="mock" bodies="cf1"/>', "bodies: 'cf1': expected rigid"),
        ('<vs:tracker format="mocap" type="mock" bodies="a=b"/>', "bodies: 'b' is not a tag"),
        ('<vs:tracker format="mocap" type="mock" bodies="a=1,b=1"/>', "bodies: tag 1 is there"),
        ('<vs:tracker format="mocap" type="mock" bodies="a=1,a=2"/>', "bodies: 'a' is there twice"),
        ('<vs:tracker format="mocap" type="mock" settings="a"/>', "settings: 'a': expected names"),
        ('<vs:tracker format="lines" port="-1"/>', "port: -1.*0"),
        ('<vs:tracker format="lines" host=""/>', "<vs:tracker> host:.*empty"),
        ('<vs:tracker format="lines" latency="1"/>', "latency:.*attribute"),
        ('<vs:tracker format="lines"/>\n<vs:tracker format="lines"/>', "x.argos:3: .*twice"),
    ],
)
def test_a_wrong_lines_tracker_is_refused_at_its_line(inside: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        read(inside=inside)


def test_there_is_one_tracker() -> None:
    with pytest.raises(ConfigError, match=r"x.argos:2: <vs:tracker>.*line 2"):
        read('ats_host="a"', inside='<vs:tracker format="lines"/>')
