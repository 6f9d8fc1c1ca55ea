"""Experiment files: what a good one says, and that a broken one is refused at its place."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.config.conftest import any_change
from tests.rigs.places import ROOT
from vsense import cli
from vsense.base.errors import ConfigError, UsageError
from vsense.config import devices
from vsense.config.experiment import first_robots, load, of_folder, shipped
from vsense.config.placement import settle
from vsense.config.specs import Experiment, Pose
from vsense.robots.link.table import Table
from vsense.robots.link.wire import Header, Hello, Welcome, encode

Read = Callable[..., Experiment]


def refused(read_text: Read, text: str) -> ConfigError:
    with pytest.raises(ConfigError, match=r"^x\.argos:[0-9]+: <[\w:-]+>.*:") as caught:
        read_text(text)
    return caught.value


def test_everything_in_the_example_is_understood(read_text: Read, example: str) -> None:
    experiment = read_text(example)
    assert (experiment.name, experiment.host, experiment.port) == ("x", "10.0.0.1", 4051)
    assert (experiment.timesteps, experiment.timestep_s, experiment.seed) == (400, 0.1, 7)
    assert [robot.id for robot in experiment.robots] == [
        "epuck_23_30", "swarm_5_40", "swarm_6_41", "swarm_7_42",
    ]  # fmt: skip
    first = experiment.robots[0]
    assert (first.tag, first.number) == (23, 30)
    assert first.pose == pytest.approx(Pose(0.5, -0.5, -math.pi / 2))
    assert [thing.tag for thing in experiment.objects] == [9, 22]
    assert [box.id for box in experiment.boxes] == ["wall_north", "crate"]
    assert experiment.boxes[1].yaw_rad == pytest.approx(math.pi / 4)
    assert experiment.controllers[0].params == {"alpha": "0.5", "wheels.speed": "3"}
    assert experiment.marker.height_m == 0.05
    (mounted,) = experiment.controllers[0].sensors
    assert mounted.quality.update_every == 3
    (source,) = experiment.sources
    assert (source.tag, source.turn_timestep, source.memory_ns) == (22, 100, 2_000_000_000)
    assert math.degrees(source.wide_rad) == pytest.approx(60)
    assert experiment.warnings == (
        "x.argos:24: <box> 'crate' is movable: nobody can push it, only loop functions move it",
    )


def test_blanks_around_a_controllers_id_count_for_nothing(read_text: Read, example: str) -> None:
    spaced = read_text(example.replace('config="mine"', 'config=" mine "'))
    assert [c.id for c in spaced.controllers] == [c.id for c in read_text(example).controllers]


def test_the_wind_turns_at_its_share_of_an_overridden_length(read_text: Read, example: str) -> None:
    assert read_text(example, 120.0).sources[0].turn_timestep == 300
    fixed = read_text(example.replace('"25%"', '"130"'), 120.0)
    assert fixed.sources[0].turn_timestep == 130


def test_the_thesis_defaults_of_the_pollutant_sensor(read_text: Read, example: str) -> None:
    (source,) = read_text(
        re.sub(r"<virtual_pollutant_sensor[^>]*>", "<virtual_pollutant_sensor/>", example)
    ).sources
    assert (source.direction_rad, source.max_distance_m, source.tag) == (0.0, 1.0, 22)
    assert source.wide_rad == pytest.approx(math.pi / 2)
    assert source.turn_timestep is None


def test_the_address_may_stand_on_the_framework_as_in_the_thesis(
    read_text: Read, example: str
) -> None:
    text = example.replace('vss_host="10.0.0.1" vss_port="4051"', "").replace(
        "<framework>",
        '<framework vss_host="10.0.0.2" vss_port="4052" ats_host="a" ats_port="4040">',
    )
    experiment = read_text(text)
    assert (experiment.host, experiment.port) == ("10.0.0.2", 4052)
    assert experiment.tracker is not None and experiment.tracker.host == "a"
    assert not [w for w in experiment.warnings if "ats_" in w]


def test_this_machine_may_be_called_by_its_name(read_text: Read, example: str) -> None:
    assert read_text(example.replace("10.0.0.1", "localhost")).host == "127.0.0.1"


def test_the_slowest_control_steps_are_beats_that_the_guard_accepts(
    read_text: Read, example: str
) -> None:
    robot = ROOT / "robot"
    (beat_ns,) = re.findall(r"VS_GUARD_BEAT_NS (\d+)u", (robot / "guard.h").read_text())
    (exchange_ms,) = re.findall(r"in at most (\d+) ms", (robot / "base.h").read_text())
    assert "1.25 timesteps" in (robot / "loop.h").read_text()

    def is_in_time(ticks_per_second: int) -> bool:
        return 1.25 * 1e9 / ticks_per_second + int(exchange_ms) * 1e6 <= int(beat_ns)

    for ticks in range(1, 101):
        text = example.replace('ticks_per_second="10"', f'ticks_per_second="{ticks}"')
        if is_in_time(ticks):
            assert read_text(text).ticks_per_second == ticks
        else:
            assert "ticks_per_second" in refused(read_text, text).message


def test_a_tag_that_the_marker_family_does_not_have_is_refused(
    read_text: Read, example: str
) -> None:
    text = example.replace('family="arrow4x4"', 'family="aruco_4x4_50"')
    read_text(text)
    for old, new, line in (("k_23_", "k_50_", 29), ("5 6 7", "5 50 7", 37), ("p_9_", "p_50_", 27)):
        with pytest.raises(ConfigError, match=r"_50_.* 'aruco_4x4_50'.*0.*49") as caught:
            read_text(text.replace(old, new))
        assert caught.value.line == line


SENSOR = "virtual_pollutant_sensor"


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ('size="3, 2.4, 1"', 'size="3, 2.4"', 20, "size: '3, 2.4' is not three numbers"),
        ('size="3, 2.4, 1"', 'size="3, -2.4, 1"', 20, "size: -2.4 is out of range"),
        ('length="40"', 'length="-1"', 5, "length: -1 is out of range, expected 0 to 1e\\+06 s"),
        ('length="40"', 'length="0"', 13, "rotation_timestep: '25%' of a run without limit"),
        ('ticks_per_second="10"', 'ticks_per_second="0"', 5, "expected 6 to 100"),
        ('ticks_per_second="10"', 'ticks_per_second="5"', 5, "5 is .* guard stops .* for 250 ms"),
        ('ticks_per_second="10"', 'ticks_per_second="101"', 5, "expected 6 to 100"),
        ('vss_host="10.0.0.1"', 'vss_host="10.0.0.256"', 5, "'10.0.0.256' is not an IPv4 address"),
        ('vss_host="10.0.0.1"', 'vss_host="host.lan"', 5, "'host.lan' is not an IPv4 .*localhost"),
        ('vss_host="10.0.0.1"', 'vss_host="::1"', 5, "'::1' is not an IPv4 address"),
        ('vss_host="10.0.0.1"', 'vss_host="10.0.0.1&#10;"', 0, None),
        ('vss_host="10.0.0.1"', 'vss_host="10.0.1"', 5, "'10.0.1' is not an IPv4 address"),
        ('vss_port="4051"', 'vss_port="65536"', 5, "vss_port: 65536 is out of range"),
        ("epuck_22_1", "epuck_22_2", 13, "there is no 'epuck_22_2'.*is 'epuck_22_1' or"),
        ('config="mine" /></e', 'config="yours" /></e', 37, "controller 'yours'; there are: mine"),
        ('library="mine.c"', 'library="yours.c"', 9, "library: no controller 'yours.c'.*pollutant"),
        ('library="mine.c"', f'library="{"x" * 5000}.c"', 9, "library: .*xxx"),
        ('library="mine.c"', 'library="x.py"', 9, "'x.py': expected .*py or .onnx file"),
        ('library="mine.c"', 'library="build/mine"', 9, "no controller 'build/mine'"),
        ('library="mine.c"', 'library="a&#10;b.c"', 9, r"no controller 'a\\nb.c'"),
        ('family="arrow4x4"', 'family="qr"', 41, "family: 'qr' is not one of: .*arrow4x4"),
        ('tags="5 6 7"', 'tags="5 6 5"', 36, "vs:tags: tag 5 is worn by another one, in line 36"),
        ('tags="5 6 7"', 'tags="5 23 7"', 36, "tag 23 is worn by another one, in line 29"),
        ('tags="5 6 7"', 'tags="5 6"', 36, "has 2 tags, expected 3"),
        ('tags="5 6 7"', 'tags="5 6 65536"', 36, "'65536' is not a whole number from 0 to 65535"),
        ("lamp_9_0", "lamp_23_0", 29, "tag 23 is worn by another one, in line 27"),
        ('id="crate"', 'id="wall_north"', 24, "is the id of another element, in line 21"),
        ('id="epuck_23_30"', 'id="epuck"', 0, None),
        ('id="epuck_23_30"', 'id="epuck" vs:tag="9"', 29, "tag: tag 9 is worn by another one"),
        ('id="epuck_23_30"', 'id="epuck_23_30" vs:tag="9"', 29, "is 9, but the id .* says 23"),
        ('id="epuck_23_30"', 'id="epuck_99999_1"', 29, "tag and number from 0 to 65535"),
        ('id="epuck_23_30"', f'id="{"e" * 26}_23_30"', 29, "has 32 bytes, expected at most 31"),
        ('id="epuck_23_30"', f'id="{"ä" * 13}_23_30"', 29, "has 32 bytes, expected at most 31"),
        ('id="epuck_23_30"', f'id="{"e" * 25}_23_30"', 0, None),
        ('id="epuck_23_30"', 'id="e&#9;puck_23_30"', 29, r"id: 'e\\tpuck_23_30' .* not printable"),
        ('id="swarm"', 'id="a&#10;touch pwned;"', 37, r"'a\\ntouch pwned;_5_40' .* not printable"),
        ('id="swarm"', f'id="{"s" * 27}"', 37, "s_5_40' has 32 bytes, expected at most 31"),
        ('id="lamp_9_0"', 'id="lamp&#x2028;_9_0"', 27, "id: .* not printable"),
        ('id="crate"', 'id="cra&#10;te"', 24, r"id: 'cra\\nte' .* not printable"),
        ('"0.5,-0.5,0"', '"1.6,0,0"', 30, "position: 1.6,0 lies outside the arena"),
        ('"0.5,-0.5,0"', '"0.5,-0.5,0.1"', 30, "z is 0.1, expected 0"),
        ('"270,0,0"', '"270,1,0"', 30, "turns about y or x"),
        ('max="1.4,1.1,0"', 'max="-2,1.1,0"', 34, "max: has a number below 'min'"),
        ('std_dev="360,0,0"', 'std_dev="-1,0,0"', 35, "std_dev: has a number below 0"),
        ('method="uniform"', 'method="grit"', 34, "'grit' is not one of: uniform, .*, grid"),
        ('wide_angle="60"', 'wide_angle="180"', 13, "wide_angle: 180 is out of range"),
        ('wide_angle="60"', 'wide_angle="0"', 13, "wide_angle: 0 is out of range"),
        ('max_distance="0.8"', 'max_distance="0"', 13, "max_distance: 0 is out of range"),
        ('"25%"', '"101%"', 13, "rotation_timestep: 101 is out of range, expected 0 to 100 %"),
        ('"25%"', '"-3"', 13, "rotation_timestep: -3 is out of range"),
        ('rotation_timestep="25%"', "", 13, "rotation_angle: needs a 'rotation_timestep'"),
        ('alpha="0.5"', f'alpha="{"x" * 4100}"', 17, "has 4122 bytes, expected at most 4096"),
        ('alpha="0.5"', 'alpha="a&#10;b"', 17, "alpha: holds a character that is not printable"),
        ('alpha="0.5"', 'wheels.speed="1"', 17, "speed: is there twice"),
        ('="mine" /></e-puck>', '="mine" /></e-puck><box/>', 36, "holds 2 known elements"),
        ("my_controller", "vs:my_controller", 0, None),
    ],
)  # fmt: skip
def test_a_wrong_value_is_refused_with_what_was_expected(
    read_text: Read, example: str, old: str, new: str, line: int, words: str | None
) -> None:
    assert old in example
    text = example.replace(old, new, 1) if old != "my_controller" else example.replace(old, new)
    if words is None:
        read_text(text)
        return
    error = refused(read_text, text)
    assert re.search(words, error.message), str(error)
    assert error.line == line


@given(st.data())
def test_any_change_gives_an_experiment_or_one_error_with_its_place(
    read_text: Read, example: str, data: st.DataObject
) -> None:
    text = any_change(data, example)
    try:
        settle(read_text(text), 1)
    except ConfigError as error:
        assert error.file == "x.argos"
        assert 1 <= error.line <= text.count("\n") + 1


@given(st.data())
def test_what_loads_can_travel(read_text: Read, example: str, data: st.DataObject) -> None:
    words = st.text(st.characters(exclude_categories=("Cc", "Cs")), max_size=40)
    text = example
    for old in ('alpha="0.5"', 'id="swarm"', 'id="epuck_23_30"'):
        key, _, value = old.partition("=")
        word = data.draw(words | st.just(value.strip('"')))
        escaped = "".join(f"&#{ord(character)};" for character in word)
        text = text.replace(old, f'{key}="{escaped}{"_23_30" if "23" in old else ""}"')
    try:
        experiment = read_text(text)
    except ConfigError:
        return
    encode(Header(2), Welcome(Table(), 100_000, 1, experiment.controllers[0].params_text))
    for robot in experiment.robots:
        encode(Header(1), Hello(bytes(16), robot.tag, robot.id, "mine"))


def test_robots_have_controllers_of_their_own(read_text: Read, example: str) -> None:
    second = example.replace("</controllers>", '<other id="o" library="mine.c"/></controllers>')
    assert any(
        "<other> is not supported: no robot uses it" in w for w in read_text(second).warnings
    )
    mixed = read_text(second.replace('config="mine" /></e', 'config="o" /></e'))
    mine, other = mixed.controllers
    assert [(c.id, c.label, len(c.sensors)) for c in (mine, other)] == [
        ("mine", "my_controller", 1),
        ("o", "other", 0),
    ]
    assert mine.sources == other.sources == ((mixed.path.parent / "mine.c").resolve(),)
    assert {r.controller for r in mixed.robots} == {"mine", "o"}
    assert mixed.driven_by(mine) == ("epuck_23_30",)
    assert first_robots(mixed, 1).controllers == (mine,)
    twice = example.replace("</controllers>", '<other id="mine" library="a"/></controllers>')
    assert "id of another controller, in line 9" in refused(read_text, twice).message


def test_an_e_puck_without_controller_is_an_object_only_where_one_is_named(
    read_text: Read, example: str
) -> None:
    text = example.replace('entity="epuck_22_1"', 'entity="lamp_9_0"')
    assert "<controller> is missing" in refused(read_text, text).message


def test_what_argos_has_and_we_do_not_is_a_warning_with_its_line(
    read_text: Read, example: str
) -> None:
    text = (
        example.replace("</arena>", '<kilobot id="l"/><prototype id="f"/></arena>')
        .replace("<epuck_proximity", '<epuck_ground/><epuck_proximity noise_level="0.1"')
        .replace("<dynamics2d", '<pointmass3d id="pm3d"/><dynamics2d')
        .replace("</argos", "<visualization><qt-opengl/></visualization></argos")
        .replace("<arena", '<loop_functions library="lib/liba.so" label="l" /><arena')
        .replace("</physics_engines>", '</physics_engines><media><radio id="r"/></media>')
    )
    warnings = "\n".join(read_text(text).warnings)
    for words in (
        "x.argos:12: <epuck_ground> is the robot's own, where it has that board; vs:virtual='true'",
        "x.argos:12: <epuck_proximity> noise_level is not used: the real one's own noise takes its",
        "x.argos:20: <loop_functions> is not supported: the sources of 'lib/liba.so', in which",
        "no loop functions are called; name them with --sources a=FILES, see",
        "x.argos:40: <kilobot> is not supported: driven here are e-pucks, foot-bots",
        "x.argos:40: <prototype> is not supported: only boxes and cylinders stand here",
        "x.argos:42: <pointmass3d> is not supported: robots move in one plane",
        "x.argos:42: <radio> is not supported: nothing is sent through it",
        "x.argos:43: <visualization> is not supported: vsense draws its own pictures",
    ):
        assert words in warnings, warnings


def test_an_unknown_experiment_names_the_known_ones(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"'polutant':.*'pollutant'"):
        load("polutant")
    with pytest.raises(UsageError, match="no experiment"):
        load("x" * 5000)
    with pytest.raises(UsageError, match=r"nothing\.argos: there is no such file"):
        load(tmp_path / "nothing.argos")
    (tmp_path / "nothin.argos").touch()
    with pytest.raises(UsageError, match=r"no such file \(is 'nothin\.argos' meant\?\)"):
        load(tmp_path / "nothing.argos")
    folder = tmp_path / "folder.argos"
    folder.mkdir()
    with pytest.raises(UsageError, match=r"folder\.argos:.*Is a directory"):
        load(folder)


def test_the_shipped_pollution_experiment_is_chapter_five() -> None:
    assert "pollutant" in shipped()
    experiment = load("pollutant")
    assert experiment.warnings == ()
    assert len(experiment.robots) == 15
    assert len({robot.tag for robot in experiment.robots} | {experiment.objects[0].tag}) == 16
    (source,) = experiment.sources
    assert source.tag == experiment.objects[0].tag
    assert experiment.controllers[0].params["stop_probability"] == "0.3"
    assert source.turn_timestep == experiment.timesteps // 2
    assert load("pollutant", 40.0).sources[0].turn_timestep == 200
    assert len(experiment.boxes) == 4


def offer(monkeypatch: pytest.MonkeyPatch, sensors: dict[str, devices.Factory]) -> None:
    """Has these sensors be all that there are."""
    shipped = devices.factories
    known = {devices.SENSORS: sensors, devices.ACTUATORS: shipped(devices.ACTUATORS)}
    monkeypatch.setattr(devices, "factories", known.__getitem__)


def test_two_sensors_of_one_name_are_refused(
    read_text: Read, example: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    pollutant = devices.factories(devices.SENSORS)[SENSOR]
    offer(monkeypatch, {SENSOR: pollutant, "again": pollutant})
    error = refused(read_text, example.replace("</sensors>", "<again/></sensors>"))
    assert "the sensor 'pollutant' is there already, in line 13" in error.message


@pytest.mark.parametrize(("layout", "fits"), [("100*f4", 2), ("500*u1", 2), ("f4", 31)])
def test_a_sensor_that_no_datagram_has_room_for_is_refused_at_its_line(
    read_text: Read, example: str, monkeypatch: pytest.MonkeyPatch, layout: str, fits: int
) -> None:
    factories = dict(devices.factories(devices.SENSORS))
    for n in range(fits + 1):
        sensor = SimpleNamespace(name=f"wide{n}", layout=layout)
        factories[f"wide{n}"] = lambda element, scope, sensor=sensor: sensor
    offer(monkeypatch, factories)

    def mounting(count: int) -> str:
        more = "".join(f"\n<wide{n}/>" for n in range(count))
        return example.replace("</sensors>", f"{more}</sensors>")

    assert len(read_text(mounting(fits)).controllers[0].sensors) == fits + 1
    error = refused(read_text, mounting(fits + 1))
    assert "the table holds more than fits one datagram" in error.message
    last = f"<wide{fits}/>"
    assert error.line == mounting(fits + 1).split(last)[0].count("\n") + 1
    assert error.message.startswith(f"<wide{fits}>")


def test_a_smaller_swarm_is_the_first_of_the_file() -> None:
    experiment = load("pollutant")
    assert first_robots(experiment, 4).robots == experiment.robots[:4]
    assert first_robots(experiment, None) is experiment
    with pytest.raises(UsageError, match=r"--robots 16:.*15"):
        first_robots(experiment, 16)


def test_what_pollutes_stays() -> None:
    experiment = load("pollutant")
    source = replace(experiment.sources[0], tag=experiment.robots[9].tag)
    polluted = replace(experiment, sources=(source,))
    assert len(first_robots(polluted, 10).robots) == 10
    with pytest.raises(UsageError, match=r"--robots 9:.*pollutes"):
        first_robots(polluted, 9)


def test_vsenses_own_names_are_no_settings_of_a_controller(read_text: Read, example: str) -> None:
    text = example.replace('<wheels speed="3"', '<wheels vs:unseen="drive" speed="3"')
    error = refused(read_text, text)
    assert "<wheels> vs:unseen" in str(error) and "nothing reads it here" in str(error)


def test_a_folder_is_the_experiment_in_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("mine", "two", "none", "foraging"):
        Path(name).mkdir()
    for name in ("mine/a.argos", "two/a.argos", "two/b.argos", "foraging/own.argos"):
        Path(name).touch()
    assert of_folder("mine") == "mine/a.argos"
    assert of_folder("foraging") == "foraging", "what comes with vsense"
    assert of_folder("mine/a.argos") == "mine/a.argos" and of_folder("nix") == "nix"
    for name, words in (("two", "got a.argos, b.argos"), ("none", "got none")):
        with pytest.raises(UsageError, match=f"^{name}: is a folder: .* {words}$"):
            of_folder(name)


def test_an_unknown_experiment_may_be_a_file_beside(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("mine.argos").touch()
    with pytest.raises(UsageError, match=r"is 'mine\.argos' meant\?"):
        load("mine")


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("mine/mine.c", r"that is a program: expected .* is 'mine/mine\.argos' meant\?"),
        ("mine/mine.py", r"that is a program: expected .* is 'mine/mine\.argos' meant\?"),
        ("mine/mien.c", r"there is no such file, .* is 'mine/mine\.argos' meant\?"),
        ("minne", r"there is no such file, .* is 'mine' meant\?"),
        ("mine/mien", r"there is no such file, .* is 'mine/mine\.argos' meant\?"),
    ],
)
def test_a_program_is_no_experiment_and_the_nearest_is_named(
    name: str, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.main(["new", "mine"]) == 0
    with pytest.raises(UsageError, match=f"^no experiment '{name}': {words}"):
        load(name)
    text = (tmp_path / "mine/mine.argos").read_text()
    (tmp_path / "mine/mine.argos").write_text(text.replace("mine.c", "mien.c"))
    with pytest.raises(ConfigError, match=r"no controller 'mien\.c': .*is 'mine\.c' meant\?"):
        load("mine/mine.argos")
    (tmp_path / "mine/mine.argos").write_text(text.replace("mine.py", "mien.py"))
    with pytest.raises(ConfigError, match=r"no such file \(is 'mine\.py' meant\?\)$"):
        load("mine/mine.argos")
