"""The schema of our additions to ARGoS's format knows exactly what the reader knows."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable
from importlib import resources as package

import pytest

from tests.config.tables import by_motion_capture, with_the_rest
from vsense.base.xml.element import Element
from vsense.base.xml.parsing import NAMESPACE
from vsense.config.specs import Experiment

Read = Callable[..., Experiment]

XS = "{http://www.w3.org/2001/XMLSchema}"
QUALITY = {"noise_level", "noise_std_dev", "implementation"}
"""Of every virtual device; ARGoS's own names."""


@pytest.fixture(scope="module")
def schema() -> ET.Element:
    file = package.files("vsense.config") / "schema" / "argos-vsense.xsd"
    return ET.fromstring(file.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def asked(read_full: Read, full: str) -> dict[str, set[str]]:
    """What the reader asks of each of our elements, and under "" our attributes of all others."""
    found: dict[str, set[str]] = {}
    seen = Element.check_all_read

    def note(element: Element) -> None:
        attributes = {key for key in element._asked_attributes if key.startswith("vs:")}
        found.setdefault("", set()).update(attributes)
        for child in element._asked_children:
            if child.startswith("vs:"):
                found.setdefault(child, set())
        if element.name.startswith("vs:"):
            children = {f"<{child}>" for child in element._asked_children}
            found.setdefault(element.name, set()).update(element._asked_attributes | children)
        seen(element)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Element, "check_all_read", note)
        read_full(full)
        read_full(with_the_rest(full))
        read_full(by_motion_capture(full))
    return found


def test_it_declares_our_namespace(schema: ET.Element) -> None:
    assert schema.get("targetNamespace") == NAMESPACE


def test_its_elements_are_those_of_the_reader(
    schema: ET.Element, asked: dict[str, set[str]]
) -> None:
    declared = {f"vs:{e.get('name')}" for e in schema.findall(f"{XS}element")}
    assert declared == asked.keys() - {""}


def test_its_attributes_are_those_of_the_reader(
    schema: ET.Element, asked: dict[str, set[str]]
) -> None:
    declared = {f"vs:{a.get('name')}" for a in schema.findall(f"{XS}attribute")}
    assert declared == asked[""]


def test_each_element_has_the_attributes_of_the_reader(
    schema: ET.Element, asked: dict[str, set[str]]
) -> None:
    for element in schema.findall(f"{XS}element"):
        declared = {a.get("name") or a.get("ref") for a in element.iter(f"{XS}attribute")}
        children = {f"<{e.get('ref')}>" for e in element.iter(f"{XS}element") if e.get("ref")}
        children |= {"<body>"} if element.find(f".//{XS}any") is not None else set()
        wanted = set(asked[f"vs:{element.get('name')}"])
        if element.get("name") in ("actuator", "sensor"):
            # The user's own attributes are any; the quality settings are those of all devices.
            assert element.find(f".//{XS}anyAttribute") is not None
            wanted = {key for key in wanted if not key.startswith("vs:")} - QUALITY
            wanted -= {"medium", "show_rays", "real_experiment", "sensor_model_file"}
        assert declared | children == wanted, element.get("name")


def test_everything_in_it_is_explained(schema: ET.Element) -> None:
    for node in [*schema.iter(f"{XS}element"), *schema.iter(f"{XS}attribute")]:
        if node.get("ref") is None:
            text = node.findtext(f"{XS}annotation/{XS}documentation") or ""
            assert len(text.strip()) > 8, node.get("name")


def test_its_defaults_are_those_of_the_reader(
    schema: ET.Element, read_full: Read, full: str
) -> None:
    field = schema.find(f"{XS}element[@name='field']")
    assert field is not None
    defaults = {a.get("name"): a.get("default") for a in field.iter(f"{XS}attribute")}
    (spec,) = read_full(
        full.replace('cell="0.05" evaporation="0.02" diffusion="0.0001" initial="0"', "")
    ).fields
    read = (spec.cell_m, spec.evaporation_per_s, spec.diffusion_m2_s, spec.initial)
    keys = ("cell", "evaporation", "diffusion", "initial")
    assert tuple(float(defaults[key] or "nan") for key in keys) == read
    marker = schema.find(f"{XS}element[@name='marker']")
    assert marker is not None
    plain = read_full(full.replace('family="arrow4x4" height="0.05"', "")).marker
    declared = {a.get("name"): a.get("default") for a in marker.iter(f"{XS}attribute")}
    assert declared == {"family": plain.family, "height": str(plain.height_m)}
