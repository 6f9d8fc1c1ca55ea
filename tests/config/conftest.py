"""A small experiment file that uses every element we understand."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import strategies as st

from tests.config.tables import OWN_ACTUATOR, OWN_SENSOR, attributes
from vsense.config.experiment import read
from vsense.config.specs import Experiment

EXAMPLE = """<?xml version="1.0" ?>
<argos-configuration xmlns:vs="urn:vsense:1">
  <framework>
    <system threads="0" />
    <experiment length="40" ticks_per_second="10" random_seed="7"
                vss_host="10.0.0.1" vss_port="4051" />
  </framework>
  <controllers>
    <my_controller id="mine" library="mine.c">
      <actuators><epuck_wheels implementation="default" /></actuators>
      <sensors>
        <epuck_proximity implementation="default" />
        <virtual_pollutant_sensor implementation="default" pollutant_entity="epuck_22_1"
          direction_angle="170" wide_angle="60" max_distance="0.8"
          rotation_timestep="25%" rotation_angle="90" vs:memory="2" vs:update_every="3" />
      </sensors>
      <params alpha="0.5"><wheels speed="3" /></params>
    </my_controller>
  </controllers>
  <arena size="3, 2.4, 1" center="0,0,0.5">
    <box id="wall_north" size="3,0.02,0.08" movable="false">
      <body position="0,1.19,0" orientation="0,0,0" />
    </box>
    <box id="crate" size="0.2,0.1,0.1" movable="true" mass="2.5" vs:physical="true">
      <body position="1,0.5,0" orientation="45,0,0" />
    </box>
    <vs:object id="lamp_9_0"><body position="-1,-1,0" orientation="0,0,0" /></vs:object>
    <e-puck id="epuck_22_1"><body position="0,0,0" orientation="0,0,0" /></e-puck>
    <e-puck id="epuck_23_30">
      <body position="0.5,-0.5,0" orientation="270,0,0" />
      <controller config="mine" />
    </e-puck>
    <distribute>
      <position method="uniform" min="-1.4,-1.1,0" max="1.4,1.1,0" />
      <orientation method="gaussian" mean="0,0,0" std_dev="360,0,0" />
      <entity quantity="3" max_trials="100" base_num="40" vs:tags="5 6 7">
        <e-puck id="swarm"><controller config="mine" /></e-puck>
      </entity>
    </distribute>
  </arena>
  <vs:rig><vs:marker family="arrow4x4" height="0.05" /></vs:rig>
  <physics_engines><dynamics2d id="dyn2d" /></physics_engines>
</argos-configuration>
"""


@pytest.fixture(scope="session")
def example() -> str:
    return EXAMPLE


@pytest.fixture(scope="session")
def read_text(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Experiment]:
    """Reads an experiment from a text, as if it were x.argos beside a controller mine.c."""
    folder: Path = tmp_path_factory.mktemp("experiment")
    (folder / "mine.c").touch()

    def read_experiment(text: str, length_s: float | None = None) -> Experiment:
        return read(text.encode(), "x.argos", folder / "x.argos", length_s)

    return read_experiment


@pytest.fixture(scope="session")
def full() -> str:
    """An experiment file that uses everything we support."""
    return (Path(__file__).parent / "full.argos").read_text()


@pytest.fixture(scope="session")
def read_full(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Experiment]:
    """Reads an experiment from a text, as if it were x.argos beside what `full` names."""
    folder: Path = tmp_path_factory.mktemp("full")
    (folder / "mine.c").touch()
    (folder / "doors.py").write_text("class Doors:\n    def reset(self, world): ...\n")
    (folder / "own.py").write_text(OWN_SENSOR)
    (folder / "act.py").write_text(OWN_ACTUATOR)
    cv2.imwrite(str(folder / "floor.png"), np.zeros((4, 6, 3), dtype=np.uint8))

    def read_experiment(text: str, settings: Mapping[str, str] | None = None) -> Experiment:
        return read(text.encode(), "x.argos", folder / "x.argos", None, settings)

    return read_experiment


def any_change(data: st.DataObject, text: str) -> str:
    """The file with any value of one attribute, and perhaps with a piece left out."""
    attribute = data.draw(st.sampled_from(attributes(text)))
    letters = st.characters(exclude_categories=("Cc", "Cs"), exclude_characters='<&"\ufffe\uffff')
    words = st.text(letters, max_size=20) | st.floats().map(repr) | st.integers().map(str)
    text = attribute.changed(text, data.draw(st.lists(words, max_size=4).map(",".join)))
    if data.draw(st.booleans()):
        cut = data.draw(st.integers(0, len(text)))
        text = text[:cut] + text[cut + data.draw(st.integers(0, 80)) :]
    return text
