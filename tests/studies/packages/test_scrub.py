"""Who and where is left out of packages; what code is whose; who says to have made one."""

from __future__ import annotations

import json
import socket
from pathlib import Path
from typing import Any

import pytest
import tomlkit
from hypothesis import given
from hypothesis import strategies as st

from vsense.base.errors import VsenseError
from vsense.base.message_bus import Message
from vsense.studies.packages import _crate, _kinds, _places, _recordings
from vsense.studies.packages._contents import PackageContents
from vsense.studies.packages._crate import Person
from vsense.studies.packages._places import (
    PackagePlaces,
    Scrubber,
    Untrusted,
    folders_of,
    shipped_file,
)

HOME = str(Path.home())
SCRUBBER = Scrubber([("/data/lab/exp", "@package/s/files"), ("/data/lab", "@package/s")])


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (f"{HOME}/notes.txt", "~/notes.txt"),
        ("see /data/lab/exp/a.c:7", "see @package/s/files/a.c:7"),
        ("/data/laboratory/x and x/data/lab", "/data/laboratory/x and x/data/lab"),
        ("robot 7 at 192.168.1.30:5000", "robot 7 at 192.0.2.1:5000"),
        ("from fe80:0:0:1:2:3:4:5 now", "from :: now"),
        ("ssh root@robot7.local", "ssh USER@HOST"),
        ("on 127.0.0.1 and 0.0.0.0", "on 127.0.0.1 and 0.0.0.0"),
        ("OpenCV 5.0.0, 1.2.3.456", "OpenCV 5.0.0, 1.2.3.456"),
        ("at 10:11:12.130", "at 10:11:12.130"),
        ("library='@package/s/files/a.c'", "library='@package/s/files/a.c'"),
    ],
)
def test_who_and_where_is_replaced_and_nothing_else(text: str, expected: str) -> None:
    assert SCRUBBER.text(text) == expected
    assert SCRUBBER.text(expected) == expected, "what was replaced stays"


def test_this_machine_is_not_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(socket, "gethostname", lambda: "hopper")
    assert Scrubber([]).text("run by ann on hopper, a grasshopper") == (
        "run by ann on HOST, a grasshopper"
    )


def test_whose_run_a_recording_is_of_is_left_out() -> None:
    for data in ({"user": "ann", "name": "x"}, {"state": "running"}):
        scrubbed = _recordings._scrubbed(Message("/experiment", 7, data), Scrubber([]))
        assert scrubbed.data == data | ({"user": None} if "user" in data else {})


def test_an_experiments_paths_are_beside_it() -> None:
    text = "<a library='/data/lab/exp/deep/c.c'/>"
    assert SCRUBBER.text(text, "s/files/tests") == "<a library='../deep/c.c'/>"


def test_a_roster_keeps_what_was_measured_and_no_hosts() -> None:
    text = '[defaults]\nhost = "pi@10.0.0.9"\n[[robot]]\ntag = 7\nhost = "x"\nuid = "af"\n'
    scrubber = Scrubber([])
    told = tomlkit.parse(scrubber.roster(text + "[[robot]]\ntag = 8\n")).unwrap()
    assert told == {"defaults": {}, "robot": [{"tag": 7, "uid": "af"}, {"tag": 8}]}
    assert scrubber.counts == {"addresses of robots": 2}
    assert "host" not in SCRUBBER.roster("host = [broken 10.0.0.9").replace("host = [", "")


def test_folders_are_found_as_deep_as_names_say() -> None:
    found = folders_of([("@package/s/sources-1/files/a/b.c", "/home/x/exp/a/b.c")])
    assert found == {
        "/home/x/exp/a/b.c": "@package/s/sources-1/files/a/b.c",
        "/home/x/exp/a": "@package/s/sources-1/files/a",
        "/home/x/exp": "@package/s/sources-1/files",
    }


@pytest.mark.parametrize(
    ("name", "stays_out"),
    [
        ("robots/31.key", True),
        ("robots/31.log", True),
        ("robots/31.sh", True),
        ("tokens.json", True),
        ("robots/31.trace", False),
        ("summary.json", False),
        ("foraging.mcap", False),
    ],
)
def test_what_is_not_known_stays_out(name: str, stays_out: bool) -> None:
    assert (_kinds.of_run(name) is None) == stays_out


NESTED = json.loads("[" * 900 + "]" * 900)
SETUP: dict[str, Any] = {
    "experiment": "foraging", "duration_s": 1.0, "robots": 2, "blind": False, "settings": {},
    "code": {"sources": {}, "includes": []}, "casting": {}, "start": None,
}  # fmt: skip


@pytest.mark.parametrize(
    "change",
    [
        {"experiment": "@package/s/files/x.argos"},
        {"experiment": "@vsense/experiments/../../x.argos"},
        {"experiment": "/etc/x.argos"},
        {"experiment": "x.argos/../y"},
        {"experiment": None},
        {"settings": {"loop_functions.library": "evil"}},
        {"settings": {"floor.path": "evil"}},
        {"settings": {"foraging.anything": "@package/evil.py"}},
        {"settings": ["x"]},
        {"code": {"sources": {"foraging": ["evil.c"]}, "includes": []}},
        {"code": {"sources": {}, "includes": ["evil"]}},
    ],
)
def test_what_is_not_vsenses_own_needs_trust(change: dict[str, Any], tmp_path: Path) -> None:
    where = PackagePlaces(tmp_path / "package", tmp_path / "anew")
    assert where.setup(SETUP, trusted=False).experiment == str(shipped_file("foraging"))
    assert _places.is_own("@vsense/experiments/foraging.argos", SETUP)
    with pytest.raises(Untrusted, match="--trust"):
        where.setup({**SETUP, **change}, trusted=False)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"duration_s": -1}, "duration_s: -1, expected more than 0 and at most 86400"),
        ({"duration_s": 1e300}, r"duration_s: 1e\+300, expected"),
        ({"duration_s": "1"}, "its set-up is damaged: TypeError"),
        ({"robots": 10**9}, "robots: 1000000000, expected"),
        ({"more": NESTED}, "its set-up is damaged: RecursionError"),
    ],
)
def test_a_setup_that_no_command_line_makes_is_refused(
    change: dict[str, Any], said: str, tmp_path: Path
) -> None:
    where = PackagePlaces(tmp_path / "package", tmp_path / "anew")
    with pytest.raises(VsenseError, match=said):
        where.setup({**SETUP, **change}, trusted=False)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("Josiah Carberry <0000-0002-1825-0097>", Person("Josiah Carberry", "0000-0002-1825-0097")),
        ("J <https://orcid.org/0000-0002-1694-233X>", Person("J", "0000-0002-1694-233X")),
        ("Ada Lovelace", Person("Ada Lovelace")),
        ("Ada <0000-0002-1825-0098>", None),
        ("<0000-0002-1825-0097>", None),
        ("Ada <ada@example.org>", None),
        ("", None),
    ],
)
def test_people_have_orcid_ids_whose_check_digit_is_right(
    text: str, expected: Person | None
) -> None:
    """Source of the two iDs: ORCID, "Structure of the ORCID Identifier"."""
    if expected is None:
        with pytest.raises(ValueError, match=r"expected NAME|is no ORCID iD"):
            _crate.person(text)
    else:
        assert _crate.person(text) == expected


@pytest.mark.parametrize("text", ["", "CC BY 4.0", "ftp://x", "a\nb"])
def test_what_is_no_licence_is_refused(text: str) -> None:
    assert _crate.license_of("CC-BY-4.0") == "https://spdx.org/licenses/CC-BY-4.0"
    with pytest.raises(ValueError, match="address"):
        _crate.license_of(text)


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner),
    max_leaves=8,
)
RUN = st.fixed_dictionaries(
    {"series": JSON, "name": JSON, "mode": st.just("sim") | JSON},
    optional={"recordings": JSON, "folder": JSON, "row": JSON, "other": JSON},
)


@given(
    format=st.just(1) | JSON,
    version=st.just("1") | JSON,
    runs=st.lists(RUN | JSON, max_size=2) | JSON,
    report=JSON,
    asked=JSON,
)
def test_whatever_a_package_says_of_itself_is_read_or_one_error(**told: Any) -> None:
    try:
        found = PackageContents.read(json.dumps(told).encode(), ["a"])
    except VsenseError as error:
        assert "is damaged" in str(error)
    else:
        assert all(run.mode in ("sim", "lab", "run") for run in found.runs)
        assert set(found.report) <= {"a"}
