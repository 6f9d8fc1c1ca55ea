"""Every broken value of an experiment file that uses everything is refused at its place."""

from __future__ import annotations

import re
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.config.conftest import any_change
from tests.config.tables import (
    DUPLICATES,
    EXPECTATION,
    KINDS,
    OPTIONAL,
    REQUIRED,
    Attribute,
    at_the_original,
    attributes,
    elements,
    mutants,
    with_the_rest,
)
from vsense.base.errors import ConfigError, UsageError
from vsense.config.description import describe
from vsense.config.placement import settle
from vsense.config.specs import Experiment

Read = Callable[..., Experiment]


def refusal(read: Read, text: str) -> ConfigError | None:
    try:
        read(text)
    except ConfigError as error:
        return error
    return None


def test_the_sample_uses_everything_and_everything_in_it_is_supported(
    read_full: Read, full: str
) -> None:
    assert read_full(full).warnings == ()
    # All but the XML declaration and the namespace are attributes that the table below knows.
    assert len(attributes(full)) == full.count('="') - 2
    for attribute in attributes(full):
        assert attribute.kind in KINDS
    unique = {a.name for a in attributes(full) if a.key == "id" and a.element != "e-puck"}
    assert {name for name in unique if name not in DUPLICATES} == set()


@pytest.mark.parametrize("variant", [str, with_the_rest, at_the_original])
def test_every_broken_value_is_refused_with_file_line_value_and_expectation(
    read_full: Read, full: str, variant: Callable[[str], str]
) -> None:
    survivors, vague, total = [], [], 0
    sample = variant(full)
    known = {(a.name, a.value) for a in attributes(full)} if sample != full else set()
    for attribute, value, text in mutants(sample):
        if (attribute.name, attribute.value) in known:
            continue
        total += 1
        error = refusal(read_full, text)
        if error is None:
            survivors.append((attribute.name, attribute.line, value))
            continue
        parts = [part.strip() for part in value.split(",")] + value.split()
        says_value = value == "" or any(part and part.rstrip("%") in str(error) for part in parts)
        # Where two clash, or what refers to it is missing, the other one may be the place.
        is_name = attribute.kind == "id" or value == DUPLICATES.get(attribute.name)
        says_value = says_value or (is_name and re.search(r"tag \d+ is worn", str(error)))
        at_place = error.line == attribute.line or is_name
        if not (says_value and at_place and EXPECTATION.search(error.message)):
            vague.append((attribute.name, attribute.line, value, str(error)))
        assert error.file == "x.argos"
    assert survivors == []
    assert vague == []
    assert total > (1400 if sample == full else 10)


NEEDED_ELSEWHERE = ("virtual_pollutant_sensor vs:amount",)
"""Without it the actuator that cleans has nothing to do: the refusal stands at that one."""


def is_optional(attribute: Attribute) -> bool:
    if attribute.name in (*REQUIRED, *NEEDED_ELSEWHERE):
        return False
    ours = attribute.key.startswith("vs:")
    return ours or attribute.key in OPTIONAL or attribute.name in OPTIONAL


@pytest.mark.parametrize("variant", [str, with_the_rest, at_the_original])
def test_every_missing_attribute_is_refused_or_has_a_default(
    read_full: Read, full: str, variant: Callable[[str], str]
) -> None:
    wrong = []
    sample = variant(full)
    for attribute in attributes(sample):
        text = sample[: attribute.start] + sample[attribute.end :]
        error = refusal(read_full, text)
        key = attribute.key.removeprefix("vs:")
        if (error is None) != is_optional(attribute):
            wrong.append((attribute.name, attribute.line, str(error)))
        elif error is not None:
            assert error.line == attribute.line or attribute.name in NEEDED_ELSEWHERE, str(error)
            assert key in error.message and EXPECTATION.search(error.message), str(error)
    assert wrong == []


def test_every_attribute_that_is_there_twice_is_refused(read_full: Read, full: str) -> None:
    for attribute in attributes(full):
        again = full[attribute.start : attribute.end]
        error = refusal(read_full, f"{full[: attribute.end]} {again}{full[attribute.end :]}")
        assert error is not None and "duplicate attribute" in error.message, attribute


def test_every_misspelt_attribute_is_refused(read_full: Read, full: str) -> None:
    for attribute in attributes(full):
        if attribute.kind == "any":
            continue
        text = (
            f'{full[: attribute.start]}{attribute.key}x="{attribute.value}"{full[attribute.end :]}'
        )
        error = refusal(read_full, text)
        if attribute.name == "loop_functions label":
            assert error is None  # the user's own settings have any name
            continue
        key = attribute.key.removeprefix("vs:").partition("_")[0]
        assert error is not None and key in error.message, (attribute, str(error))


NEEDED = {
    "framework", "experiment", "controllers", "my_controller", "arena", "body", "controller",
    "position", "orientation", "entity",
}  # fmt: skip


@pytest.mark.parametrize("mutation", ["missing", "twice", "unknown child"])
def test_every_element_is_refused_where_it_cannot_be(
    read_full: Read, full: str, mutation: str
) -> None:
    wrong = []
    for name, start, end in elements(full):
        body = full[start:end]
        if mutation == "missing":
            text = full[:start] + full[end:]
            expected = name in NEEDED and not body.startswith('<controller config="mine" />\n')
            if name == "controller":
                continue  # without it an e-puck is an object, or a virtual robot is not driven
        elif mutation == "twice":
            text, expected = f"{full[:end]}\n{full[start:]}", True
        else:
            text = f"{full[:start]}<zzz/>{full[start:]}"
            expected = name not in ("wheels", "open")
        error = refusal(read_full, text)
        if expected and (error is None or error.file != "x.argos" or error.line < 1):
            wrong.append((mutation, name, full.count("\n", 0, start) + 1))
    assert wrong == []


@pytest.mark.parametrize("name", ["\U00018cd6", "a&#10;b"])
def test_a_distributed_things_name_must_be_printable(read_full: Read, full: str, name: str) -> None:
    with pytest.raises(ConfigError, match="not printable") as refused:
        read_full(full.replace('id="brick"', f'id="{name}"'))
    assert refused.value.line == 1 + full[: full.index('id="brick"')].count("\n")


@given(st.data())
def test_any_change_gives_an_experiment_or_one_error_with_its_place(
    read_full: Read, full: str, data: st.DataObject
) -> None:
    text = any_change(data, full)
    try:
        experiment = read_full(text)
        settle(experiment, 1)
        describe(experiment)
    except ConfigError as error:
        assert error.file == "x.argos"
        assert 1 <= error.line <= text.count("\n") + 1


@given(st.dictionaries(st.text(max_size=20) | st.just("sensor.noise"), st.text(max_size=8)))
def test_any_settings_give_an_experiment_or_one_error(
    read_full: Read, full: str, settings: dict[str, str]
) -> None:
    try:
        read_full(full, settings)
    except ConfigError as error:
        assert error.file == "x.argos"
    except UsageError as error:
        assert "setting" in str(error)
