"""Files that somebody named: nothing that never ends, nothing of gigabytes, no odd numbers."""

from __future__ import annotations

import json
import os
import socket
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsense.base.errors import VsenseError
from vsense.base.files import (
    LOG_END_BYTES,
    MOST_LOG_BYTES,
    cut_log,
    log_ends,
    parse_json,
    read_bytes,
    read_text,
    replace_text,
)
from vsense.config import battery_history, experiment, resources, roster
from vsense.monitor.recording.reader import open_recording
from vsense.monitor.ui.access import read_tokens
from vsense.studies.series import _plan
from vsense.vision.calibration._views import read_table
from vsense.vision.cameras._recordings import read_timestamps
from vsense.vision.cameras.camera import Camera, CameraError
from vsense.vision.cameras.picture import read_picture
from vsense.vision.markers.families import load_family

READERS: dict[str, Callable[[Path], object]] = {
    "x.argos": experiment.load,
    "resources.xml": resources.load,
    "tokens": read_tokens,
    "robots.toml": roster.read,
    "plan.toml": _plan.read,
    "robots.battery.csv": battery_history.read,
    "times.csv": lambda path: read_timestamps(path, False),
    "views.csv": lambda path: read_table(path, ["x"]),
    "picture.png": read_picture,
    "family.json": lambda path: load_family(str(path)),
    "run.mcap": open_recording,
}


@pytest.mark.parametrize("name", READERS)
def test_pipes_sockets_devices_and_folders_are_refused_at_once(name: str, tmp_path: Path) -> None:
    odd = tmp_path / name
    os.mkfifo(odd)
    with pytest.raises(VsenseError, match="is a pipe, expected a file"):
        READERS[name](odd)
    odd.unlink()
    odd.symlink_to("/dev/zero")
    with pytest.raises(VsenseError, match="is a device, expected a file"):
        READERS[name](odd)
    odd.unlink()
    odd.mkdir()
    with pytest.raises(VsenseError, match=r"[Ii]s a directory"):
        READERS[name](odd)


def test_a_socket_is_refused(tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as own:
        own.bind(str(tmp_path / "s"))
        with pytest.raises(OSError, match="No such device or address"):
            read_bytes(tmp_path / "s")


@pytest.mark.parametrize("name", [name for name in READERS if name != "run.mcap"])
def test_the_size_is_looked_at_before_anything_is_read(name: str, tmp_path: Path) -> None:
    large = tmp_path / name
    large.touch()
    os.truncate(large, 3 << 30)
    with pytest.raises(VsenseError, match="3072 MB"):
        READERS[name](large)


def test_a_file_that_lies_about_its_size_is_read_up_to_the_limit(tmp_path: Path) -> None:
    assert read_text(Path("/proc/self/comm"))  # which claims to be empty
    path = tmp_path / "x"
    path.write_bytes(b"x" * 100)
    assert read_bytes(path, 100) == b"x" * 100
    with pytest.raises(OSError, match="0 MB"):
        read_bytes(path, 99)


BAD = ("1e400", "-1e999", "NaN", "Infinity", "-Infinity", "9" * 5000, str(1 << 63))


@pytest.mark.parametrize("number", BAD)
def test_numbers_that_nothing_measures_are_refused_with_their_line(number: str) -> None:
    with pytest.raises(json.JSONDecodeError, match="finite") as caught:
        parse_json(f'{{"a": 1,\n "b": "x",\n "c": [{number}]}}')
    assert caught.value.lineno == 3 and caught.value.msg.startswith(f"c is {number[:20]}")
    assert len(caught.value.msg) < 90


@pytest.mark.parametrize("text", ["[" * 100_000, '{"a":' * 100_000, "[1e300," * 100_000])
def test_what_is_nested_too_deeply_is_no_json(text: str) -> None:
    with pytest.raises(json.JSONDecodeError, match="nested too deeply"):
        parse_json(text)


@given(
    st.recursive(
        st.integers(-(2**63) + 1, 2**63 - 1) | st.floats(allow_nan=False, allow_infinity=False)
        | st.text() | st.booleans() | st.none(),
        lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
        max_leaves=8,
    )
)  # fmt: skip
def test_everything_else_is_as_json_has_it(value: object) -> None:
    assert parse_json(json.dumps(value)) == value


def test_a_camera_of_infinite_focal_length_is_none() -> None:
    text = json.dumps({"id": "a", "width_px": 640, "height_px": 480, "fx_px": 500.0})
    with pytest.raises(CameraError, match=r"line 1: fx_px.*1e400"):
        Camera.from_json(text.replace("500.0", "1e400"))


@pytest.mark.parametrize(("mode", "found"), [(None, 0o640), (0o600, 0o600)])
def test_a_file_is_replaced_whole_and_keeps_its_mode(
    tmp_path: Path, mode: int | None, found: int
) -> None:
    path = tmp_path / "plan"
    replace_text(path, "first\n")
    mask = os.umask(0)
    os.umask(mask)
    assert path.stat().st_mode & 0o777 == 0o666 & ~mask
    path.chmod(0o640)
    replace_text(path, "second\n", mode)
    assert (path.read_text(), path.stat().st_mode & 0o777) == ("second\n", found)
    with pytest.raises(UnicodeEncodeError):
        replace_text(path, "\udc80", mode)
    assert [p.name for p in tmp_path.iterdir()] == ["plan"], "nothing is left of half a file"
    assert path.read_text() == "second\n"


def test_of_a_log_without_end_its_ends_are_read_in_whole_lines(tmp_path: Path) -> None:
    """A program that printed all the time made 800 MB, which a run read while robots stood."""
    log = tmp_path / "31.log"
    log.write_text("began\n" + "again\n" * 1_000_000 + "killed\n")
    lines = log_ends(log).splitlines()
    assert lines[0] == "began" and lines[-1] == "killed" and set(lines[1:-1]) == {"again"}
    assert sum(map(len, lines)) < 2 * LOG_END_BYTES
    log.write_text("began\nkilled")
    assert log_ends(log) == "began\nkilled"


def test_a_log_without_end_keeps_its_beginning_and_what_came_last(tmp_path: Path) -> None:
    """A controller that printed in a loop made 810 MB in half a minute."""
    path = tmp_path / "31.log"
    cut_log(path)
    with path.open("ab", buffering=0) as robot:
        robot.write(b"began\n")
        cut_log(path)
        assert path.read_bytes() == b"began\n"
        for _ in range(5):
            robot.write(b"again\n" * (MOST_LOG_BYTES // 12))
            cut_log(path)
            assert path.stat().st_size <= MOST_LOG_BYTES
        robot.write(b"killed\n")
    text = path.read_bytes()
    assert text.startswith(b"began\n") and text.endswith(b"again\nkilled\n")
    assert text.count(b"vsense: here lines are cut out: more than 16 MB were printed\n") == 1
