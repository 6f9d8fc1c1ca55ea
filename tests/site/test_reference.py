"""The generated reference has everything that is read, and nothing else."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET

import pytest

from scripts.site import docstrings, reference
from scripts.site.contents import ROOT
from scripts.site.generated import WRITERS
from scripts.site.observing import Asked, AskedElement, observed
from scripts.site.sentences import Sentences, missing
from vsense.config.devices import ACTUATORS, SENSORS, factories, of_argos

XS = "{http://www.w3.org/2001/XMLSchema}"


@pytest.fixture(scope="module")
def asked() -> Asked:
    return observed()


@pytest.fixture(scope="module")
def page() -> str:
    return reference.page()


def test_everything_that_is_read_has_a_sentence(asked: Asked) -> None:
    sentences = Sentences()
    assert missing(asked, sentences) == []
    assert sentences.unused() == set()


def test_what_has_no_sentence_is_named() -> None:
    found = AskedElement()
    found.attributes["glow"] = found.attributes["vs:glow"] = next(iter(_any_attribute().values()))
    assert missing({("arena", "ghost"): found, ("arena", "box"): found}, Sentences()) == [
        "<arena>: <box> glow",
        "<arena>: <box> vs:glow",
        "<arena>: <ghost>",
        "<arena>: <ghost> glow",
        "<arena>: <ghost> vs:glow",
    ]


def _any_attribute() -> dict[str, reference.AskedAttribute]:
    return {"": reference.AskedAttribute()}


def test_every_name_of_ours_is_on_the_page(page: str) -> None:
    """Those that the schema for editors declares; the schema's own test holds it to the reader."""
    root = ET.parse(ROOT / "vsense/config/schema/argos-vsense.xsd").getroot()
    elements = {f"vs:{e.get('name')}" for e in root.findall(f"{XS}element")}
    attributes = {f"vs:{a.get('name')}" for a in root.findall(f"{XS}attribute")}
    assert len(elements) >= 7 and len(attributes) >= 25
    titles = re.findall(r"^#+ `<(.*)>`(?: \(actuator\))?$", page, re.M)
    assert elements - {*titles} == set()
    assert {name for name in attributes if f"\n| `{name}` | " not in page} == set()


def test_every_device_is_on_the_page(page: str) -> None:
    for kind in (SENSORS, ACTUATORS):
        for name in (*factories(kind), *of_argos(kind)):
            assert f"#### `<{name}>`" in page, name


def test_every_element_is_in_one_chapter(asked: Asked, page: str) -> None:
    shown = re.findall(r"^####? `<([^>]+)>`", page, re.MULTILINE)
    names = {name for _, name in asked}
    assert set(shown) == names


def test_types_units_and_defaults_are_those_of_the_reader(page: str) -> None:
    # As an experiment's author knows them: from the thesis and ARGoS's own files.
    row = re.search(r"\n\| `ticks_per_second` \|.*\|", page)
    assert row is not None and "whole number, 1 to 100 | required" in row[0]
    assert "| number [m], 0.001 to 10 | `0.02` |" in page  # vs:field cell
    assert "one of `thesis`, `generic`, `epuck` | `thesis` |" in page


def test_the_example_of_each_device_is_xml(page: str) -> None:
    examples = re.findall(r"```xml\n(.*?)\n```", page, re.DOTALL)
    assert len(examples) > 30
    for example in examples:
        ET.fromstring(f'<a xmlns:vs="urn:vsense:1">{example}</a>')


def test_docstrings_become_markdown() -> None:
    text = """First *line*.

    Then:

        <a b="1" />

    Args:
        one: it is
            long.
        two_x: short.

    Source: a book.
    """
    assert docstrings.markdown(text) == (
        'First \\*line\\*.\n\nThen:\n\n```xml\n<a b="1" />\n```\n\n'
        "Args:\n\n- `one`: it is long.\n- `two_x`: short.\n\n*Source:* a book."
    )


@pytest.mark.parametrize("name", sorted(WRITERS))
def test_generated_pages_have_a_heading_and_whole_blocks(name: str) -> None:
    text = WRITERS[name]()
    assert text.startswith("# ")
    assert text.count("\n```") % 2 == 0
