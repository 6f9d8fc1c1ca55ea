"""The element tree: lines, typed attributes, and what nobody asked for."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsense.base.errors import ConfigError
from vsense.base.xml.element import Element
from vsense.base.xml.parsing import parse

NAN_AND_FRIENDS = [
    "nan",
    "NaN",
    "inf",
    "-inf",
    "Infinity",
    "abc",
    "1,5",
    "0x10",
    "1_000",
    "٣",
    "1e",
    "--1",
]


def element(attributes: str = "", inner: str = "") -> Element:
    return parse(f"<root>\n\n<light {attributes}>{inner}</light></root>".encode(), "x.argos").child(
        "light"
    )


def test_an_error_names_file_line_element_attribute_value_and_expectation() -> None:
    with pytest.raises(ConfigError) as caught:
        element('intensity="abc"').number("intensity", 0, 10)
    assert str(caught.value) == "x.argos:3: <light> intensity: 'abc' is not a number"


@pytest.mark.parametrize("text", NAN_AND_FRIENDS)
def test_what_is_no_finite_number_is_refused(text: str) -> None:
    wrong = element(f'a="{text}" b="1,{text},3"')
    for read in (
        lambda: wrong.number("a", -1e300, 1e300),
        lambda: wrong.integer("a", -(10**12), 10**12),
        lambda: wrong.integers("a", -(10**6), 4),
        lambda: wrong.angle("a", -360, 360),
        lambda: wrong.vector("b", -1e300, 1e300),
    ):
        with pytest.raises(
            ConfigError, match=r"x\.argos:3: <light> [ab]: .* is (not|out of range)"
        ):
            read()


@pytest.mark.parametrize("text", ["1e308", "-1e308", "1e999", "9" * 400])
def test_out_of_range_says_the_range(text: str) -> None:
    with pytest.raises(ConfigError, match=r"range.*0.*10 m"):
        element(f'a="{text}"').number("a", 0, 10, "m")


@given(st.floats(-1e6, 1e6))
def test_a_written_number_reads_back_exactly(value: float) -> None:
    assert element(f'a=" {value!r} "').number("a", -1e6, 1e6) == value


def test_typed_values() -> None:
    light = element('a="90" v="1, 2 ,-3.5" b="true" c="red" i="-7" t="3, 1 2" p="50%"')
    assert light.angle("a", 0, 360) == pytest.approx(math.pi / 2)
    assert light.vector("v", -10, 10) == (1.0, 2.0, -3.5)
    assert light.boolean("b") is True
    assert light.choice("c", ("red", "blue")) == "red"
    assert light.integer("i", -10, 10) == -7
    assert light.integers("t", 0, 5) == [3, 1, 2]
    assert light.share("p") == 0.5
    assert light.number("absent", 0, 1, "m", 0.25) == 0.25
    assert light.boolean("absent", False) is False


def test_a_missing_attribute_says_what_was_expected_and_what_may_be_meant() -> None:
    with pytest.raises(ConfigError, match=r"intensity:.*0.*9.*'intensty'"):
        element('intensty="1"').number("intensity", 0, 9)


def test_unknown_attributes_and_elements_are_refused_with_what_is_known() -> None:
    light = element('id="a" colour="red"')
    light.text("id")
    light.has("color")
    with pytest.raises(ConfigError, match=r"colour:.*'color'"):
        light.check_all_read()
    light = element("", "\n<body/>\n<bdoy/>")
    light.optional_child("body")
    with pytest.raises(ConfigError, match=r"x\.argos:5: <bdoy>:.*<light>"):
        light.check_all_read()


def test_children_come_once_or_with_the_line_of_the_first() -> None:
    light = element("", "\n<body/>\n<body/>")
    with pytest.raises(ConfigError, match=r"x\.argos:5: <body>:.*<light>.*line 4"):
        light.child("body")
    with pytest.raises(ConfigError, match=r"x\.argos:3: <light>: <body>"):
        element().child("body")


def test_what_is_left_out_is_a_warning_and_is_not_looked_into() -> None:
    root = parse(b"<root>\n<floor path='x'><what/></floor></root>", "x.argos")
    root.children("floor")[0].leave_out("the floor is grey")
    root.check_all_read()
    assert root.document.warnings() == ("x.argos:2: <floor> is not supported: the floor is grey",)


def test_our_names_are_known_by_the_namespace_whatever_the_prefix() -> None:
    root = parse(b"<root xmlns:q='urn:vsense:1' q:tags='1 2'><q:rig/></root>", "x.argos")
    assert root.integers("vs:tags", 0, 9) == [1, 2]
    assert root.child_names() == ["vs:rig"]


@pytest.mark.parametrize(
    ("xml", "line", "words"),
    [
        (b"", 1, "the file is empty"),
        (b"<root>\n<a></root>", 2, "mismatched tag"),
        (b"<root a='1'\n a='2'/>", 2, "duplicate attribute"),
        (b"<root>\nhello</root>", 2, "text 'hello'"),
        (b"<root vs:tags='1'/>", 1, "unbound prefix"),
        (
            b"<root xmlns:vs='urn:vsense:2'>\n<vs:rig/></root>",
            2,
            "namespace 'urn:vsense:2'",
        ),
        (b"<!DOCTYPE r [<!ENTITY a 'b'>]>\n<r>&a;</r>", 1, "DOCTYPE"),
        (b"<?xml version='1.0' encoding='klingon'?><r/>", 1, "encoding"),
        (b"<r>\xff\xfe</r>", 1, "not well-formed"),
        (
            b"<r>\n<vs:tags/></r>",
            2,
            'unbound prefix .*xmlns:vs="urn:vsense:1"',
        ),
        (b"<a>" * 40 + b"</a>" * 40, 1, "32 elements"),
        (b"<a>" + b" " * (1 << 20) + b"</a>", 1, "bytes"),
    ],
)
def test_broken_xml_is_one_clear_line(xml: bytes, line: int, words: str) -> None:
    with pytest.raises(ConfigError, match=words) as caught:
        parse(xml, "x.argos")
    assert (caught.value.file, caught.value.line) == ("x.argos", line)


@pytest.mark.parametrize("head", ["", '<?xml version="1.0" ?>', "<?xml version='1.0'  ?>"])
def test_bytes_that_are_no_utf_8_are_latin_1_in_a_file_of_argos(head: str) -> None:
    text = f"{head}<r>\n<!-- für -->\n<a n='Björn'/></r>"
    with pytest.raises(ConfigError, match="not well-formed"):
        parse(text.encode("latin-1"), "x.argos")
    root = parse(text.encode("latin-1"), "x.argos", of_argos=True)
    assert root.child("a").text("n") == "Björn"
    (warning,) = root.document.warnings()
    assert warning.startswith("x.argos:2: what is no UTF-8 is read as Latin-1")
    for code in ("utf-8", "utf-16"):
        root = parse(text.encode(code), "x.argos", of_argos=True)
        assert root.child("a").text("n") == "Björn" and not root.document.warnings()
    lying = text.replace(head, "<?xml version='1.0' encoding='UTF-8' standalone='yes'?>", 1)
    root = parse(lying.encode("latin-1"), "x.argos", of_argos=True)
    assert root.child("a").text("n") == "Björn"


@given(st.binary(max_size=200))
def test_any_bytes_give_a_tree_or_one_named_error(data: bytes) -> None:
    try:
        parse(data, "x.argos")
    except ConfigError as error:
        assert error.file == "x.argos"
        assert error.line >= 1


@pytest.mark.parametrize(
    ("data", "line", "words"),
    [
        (b"", 1, "the file is empty"),
        (b" \n\n", 3, "the file is empty"),
        (b"<r>\n<a>\n<b x='1'>\n</a></r>", 4, "; <b>, opened in line 3, is open"),
        (b"<r>\n<a></a>\n<b>", 3, "; <b>, opened in line 3, is open"),
    ],
)
def test_what_is_not_closed_is_named_with_its_line(data: bytes, line: int, words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse(data, "x.xml", of_argos=True)
    assert (caught.value.line, words in caught.value.message) == (line, True), caught.value.message


def test_values_without_quotes_are_taken_as_argos_takes_them() -> None:
    """Source: argos3's tinyxmlparser.cpp, TiXmlAttribute::Parse: up to a blank, `/` or `>`."""
    text = b"<a b=1 c = x\n d=\"e=f\" g=h><!-- i=j --><k l=0.5/><m n='o=p'>q = r</m></a>"
    root = parse(text, "x.argos", of_argos=True)
    found = {key: e.peek(key) for e in root.walk() for key in "bcdgln" if e.peek(key) is not None}
    assert found == {"b": "1", "c": "x", "d": "e=f", "g": "h", "l": "0.5", "n": "o=p"}
    assert [e.line for e in root.walk()] == [1, 2, 2]
    assert list(root.walk())[2].take_text() == "q = r"
    assert (1, "the value '1' has no quotes (nor have 3 more); XML asks for them") in (
        root.document.passed_over
    )
    with pytest.raises(ConfigError, match=r"x\.argos:1: not well-formed"):
        parse(b'<a b=1" />', "x.argos", of_argos=True)
    with pytest.raises(ConfigError, match=r"x\.xml:1: not well-formed"):
        parse(b"<a b=1 />", "x.xml")
