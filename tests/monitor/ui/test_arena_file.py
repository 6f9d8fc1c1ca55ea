"""The experiment's file with what people changed, read again by the real reader."""

from __future__ import annotations

import json
import re
import sys
import urllib.request
from pathlib import Path
from typing import Any

import pytest

import vsense
from tests.conftest import require_tool
from tests.monitor.ui.conftest import Open
from tests.monitor.ui.portrait import state
from tests.rigs.processes import Program
from vsense.base.message_bus import Message
from vsense.config.experiment import load
from vsense.monitor.ui._arena_file import ArenaFile

SHIPPED = Path(vsense.__file__).parent / "config" / "experiments"
FORAGING = (SHIPPED / "foraging.argos").read_text()


def following(text: str, *changes: tuple[dict[str, Any], str]) -> ArenaFile:
    """A file of which these changes were carried out."""
    file = ArenaFile()
    name = "foraging" if text == FORAGING else "x"
    file.receive(Message("/experiment", 0, {"name": name, "seed": 1, "file_text": text}))
    for number, (change, words) in enumerate(changes):
        order = {"timestep": number, "change": change, "text": words}
        # A page that joins has a simulation repeat it.
        for _ in range(2):
            file.receive(Message("/orders", 0, order))
    return file


def move(name: str, x_m: float, y_m: float) -> tuple[dict[str, Any], str]:
    return {"kind": "move", "name": name, "x_m": x_m, "y_m": y_m}, f"{name} is at {x_m}, {y_m} m"


def put(setting: str, value: object, **of: str) -> tuple[dict[str, Any], str]:
    return {"kind": "set", "setting": setting, "value": value, **of}, f"{setting} is {value}"


def test_all_changes_are_read_again_and_the_rest_is_as_it_was(tmp_path: Path) -> None:
    add = {"kind": "add", "x_m": 0.3, "y_m": -0.2}
    file = following(
        FORAGING,
        move("nest", -0.5, 0.25), move("wall_north", 0.1, 1.1), move("nest", -0.6, 0.3),
        put("radius_m", 0.4, name="food"), put("evaporation_per_s", 0.05, name="trail"),
        put("noise_level", 0.25, name="rgb_ground", controller="ant"),
        put("drop_out", 0.1, name="destination", controller="ant"),
        put("nest", "food"),
        (add, "visitor 1 stands at 0.30, -0.20 m: a virtual robot"),
        move("visitor 1", 0.4, -0.1),
        move("robot --> epuck_31_0", 0.0, 0.0),
    )  # fmt: skip
    text = file.edited()
    path = tmp_path / "changed.argos"
    path.write_text(text)
    experiment = load(path)
    things = {thing.id: thing for thing in experiment.entities}
    assert (things["nest"].x_m, things["nest"].y_m) == (-0.6, 0.3)
    assert things["food"].radius_m == 0.4
    assert (things["visitor 1"].x_m, things["visitor 1"].y_m) == (0.4, -0.1)
    assert things["wall_north"].position_m == (0.1, 1.1, 0.0)
    assert [field.evaporation_per_s for field in experiment.fields] == [0.05]
    sensors = {s.sensor.name: s.quality for c in experiment.controllers for s in c.sensors}
    assert (sensors["rgb_ground"].noise_level, sensors["destination"].drop_out) == (0.25, 0.1)
    assert 'nest="food"' in text and "- -&gt; epuck_31_0 is at" in text
    kept = set(FORAGING.splitlines())
    assert sum(line not in kept for line in text.splitlines()) == 9


def test_the_next_run_begins_as_the_file_says() -> None:
    file = following(FORAGING, move("nest", -0.5, 0.25))
    again = Message("/experiment", 0, {"name": "foraging", "seed": 1, "file_text": FORAGING})
    file.receive(again)
    plain = FORAGING.replace('"foraging.py"', f'"{SHIPPED / "foraging.py"}"')
    assert file.edited() != plain
    file.receive(Message("/experiment", 0, {**again.data, "seed": 2}))
    assert file.edited() == plain


def test_files_beside_an_original_of_the_users_are_named_from_anywhere(tmp_path: Path) -> None:
    (tmp_path / "own & mine.py").write_text("")
    text = '<a><loop_functions library="own &amp; mine.py" label="other.py" /></a>'
    file = ArenaFile()
    made = {"path": str(tmp_path / "x.argos")}
    file.receive(
        Message("/experiment", 0, {"name": "x", "seed": 1, "file_text": text, "made": made})
    )
    whole = f"{tmp_path}/own &amp; mine.py"
    assert file.edited() == text.replace("own &amp; mine.py", whole)


def test_an_arena_that_was_edited_in_a_simulation_is_saved(tmp_path: Path, opened: Open) -> None:
    require_tool("cc", "build-essential")
    words = ["sim", "foraging", "--web", "0", "--hold", "-o", str(tmp_path / "run")]
    run = Program([sys.executable, "-m", "vsense", *words])
    try:
        url = run.wait_for(r"control room: http://\S+").split()[-1]
        page = opened(url)
        state(page, "paused")
        change = json.dumps({"change": move("food", 0.2, -0.7)[0]})
        page.value(f"vsense.connection.say({change})")
        page.until("vsense.store.settled === 1")
        page.key("e")
        page.until("document.querySelector('#edit_save').offsetParent")
        with urllib.request.urlopen(page.value("document.querySelector('#edit_save').href")) as got:
            text = got.read().decode()
            name = got.headers["Content-Disposition"]
    finally:
        run.process.terminate()
        run.end()
    assert name == 'attachment; filename="foraging-changed.argos"'
    assert re.search(r'id="food" .*position="0.2,-0.7,0"', text)


@pytest.mark.parametrize("text", ["", "no markup", "<a b='</arena>'", "</arena>"])
def test_no_text_is_too_strange(text: str) -> None:
    file = following(text, move("nest", 1.0, 1.0), put("value", 1.0, name="nest"))
    assert "nest is at 1.0" in file.edited()


@pytest.mark.parametrize("piece", ["<!--", "<![CDATA[", "<?", "<a b='", "<a ", "a", "<a/>", "<a>"])
def test_a_recordings_text_of_a_megabyte_takes_no_minutes(piece: str) -> None:
    """Each would, were what does not end looked through again from each of its beginnings."""
    text = f"<a{piece * (1_000_000 // len(piece))}"
    assert following(text, put("radius_m", 0.4, name="food")).edited().endswith(text[-80:])
