"""Robots and tagged objects: where a tag comes from, and who gets one."""

from __future__ import annotations

import re
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsense.base.errors import ConfigError
from vsense.config.specs import Experiment
from vsense.vision.markers.families import load_family
from vsense.world.entities import VIRTUAL_TAG_MIN

Read = Callable[..., Experiment]

PLAIN = """
  <distribute>
    <position method="uniform" min="-1.4,-1.1,0" max="1.4,1.1,0" />
    <orientation method="uniform" min="0,0,0" max="360,0,0" />
    <entity quantity="{}" max_trials="500" base_num="3">
      <e-puck id="fb"><controller config="mine" /></e-puck>
    </entity>
  </distribute></arena>"""


def with_plain(example: str, quantity: int) -> str:
    return example.replace("</arena>", PLAIN.format(quantity))


def by_name(experiment: Experiment) -> dict[str, int]:
    return {body.id: body.tag for body in (*experiment.robots, *experiment.objects)}


def test_robots_without_tags_get_the_ids_of_argos_and_tags_that_nobody_wears(
    read_text: Read, example: str
) -> None:
    experiment = read_text(with_plain(example, 4))
    tags = by_name(experiment)
    assert [name for name in tags if name.startswith("fb")] == ["fb3", "fb4", "fb5", "fb6"]
    assert len(set(tags.values())) == len(tags)
    assert all(tag < load_family("arrow4x4").tags for tag in tags.values())
    worn = ", ".join(str(tags[f"fb{i}"]) for i in range(3, 7))
    (warning,) = [w for w in experiment.warnings if "vs:tags" in w]
    assert re.fullmatch(
        rf"x\.argos:\d+: <entity> vs:tags is missing: 'fb3' to 'fb6' wear {worn}; a roster .*",
        warning,
    )


def test_another_robot_leaves_the_others_their_tags(read_text: Read, example: str) -> None:
    few, many = (by_name(read_text(with_plain(example, n))) for n in (4, 30))
    assert {name: many[name] for name in few} == few


def test_a_tag_beside_any_id(read_text: Read, example: str) -> None:
    text = example.replace('id="lamp_9_0"', 'id="lamp" vs:tag="12"').replace(
        'id="epuck_23_30"', 'id="leader"'
    )
    experiment = read_text(text)
    assert by_name(experiment)["lamp"] == 12
    (warning,) = [w for w in experiment.warnings if "vs:tag " in w]
    words = f"x.argos:29: <e-puck> vs:tag is missing: 'leader' wear {by_name(experiment)['leader']}"
    assert warning == f"{words}; a roster gives them others: vsense robot init"


def test_small_families_run_out_of_tags(read_text: Read, example: str) -> None:
    small = example.replace('"arrow4x4"', '"aruco_4x4_50"')
    assert sorted(by_name(read_text(with_plain(small, 44))).values()) == list(range(50))
    with pytest.raises(ConfigError, match=r"<entity>:.*'aruco_4x4_50'"):
        read_text(with_plain(small, 45))


@given(st.lists(st.integers(0, 65535), min_size=3, max_size=3, unique=True))
def test_given_tags_are_worn_and_assigned_ones_keep_away_from_them(
    read_text: Read, example: str, tags: list[int]
) -> None:
    if {9, 22, 23} & set(tags):
        return
    text = with_plain(example, 3).replace('"5 6 7"', f'"{" ".join(map(str, tags))}"')
    found = by_name(read_text(text))
    assert [found[f"swarm_{tag}_{number}"] for number, tag in enumerate(tags, 40)] == tags
    assert len(set(found.values())) == len(found)


def test_virtual_robots_have_tags_of_their_own_and_perhaps_a_controller(
    read_text: Read, example: str
) -> None:
    ghost = '<e-puck id="{}" vs:virtual="true"><body position="0,-1,0" orientation="0,0,0" />{}'
    driven = '<controller config="mine" /></e-puck>'
    text = example.replace(
        "</arena>", f"{ghost.format('g', '</e-puck>')}{ghost.format('h', driven)}</arena>"
    )
    experiment = read_text(text)
    assert [(r.id, r.tag, r.controller) for r in experiment.virtual_robots] == [
        ("g", VIRTUAL_TAG_MIN, ""),
        ("h", VIRTUAL_TAG_MIN + 1, "mine"),
    ]
    assert "g" not in by_name(experiment)
    with pytest.raises(ConfigError, match="controller 'nobody'"):
        read_text(
            text.replace('config="mine" /></e-puck></arena>', 'config="nobody" /></e-puck></arena>')
        )


def test_virtual_robots_alone_are_no_experiment(read_text: Read, example: str) -> None:
    start, end = example.index('<e-puck id="epuck_23_30">'), example.index("</arena>")
    text = example[:start] + '<e-puck id="g" vs:virtual="true"><body position="0,1,0"'
    text += ' orientation="0,0,0" /></e-puck>' + example[end:]
    with pytest.raises(ConfigError, match=r"robot.*<e-puck>"):
        read_text(text)
