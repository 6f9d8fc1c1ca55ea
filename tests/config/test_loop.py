"""Loop functions as an experiment file names them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from vsense.base.errors import ConfigError
from vsense.config.experiment import read
from vsense.config.specs import LoopSpec

ReadWith = Callable[[str], "LoopSpec | None"]


@pytest.fixture
def read_with(tmp_path: Path, example: str) -> ReadWith:
    """Reads the example with a <loop_functions>, beside the files of tmp_path."""
    (tmp_path / "mine.c").touch()

    def read_loop_functions(element: str) -> LoopSpec | None:
        text = example.replace("<arena", f"{element}\n<arena")
        return read(text.encode(), "x.argos", tmp_path / "x.argos").loop_functions

    return read_loop_functions


def test_a_python_file_with_settings_of_its_own(tmp_path: Path, read_with: ReadWith) -> None:
    (tmp_path / "doors.py").write_text("def reset(world): ...\n")
    spec = read_with(
        '<loop_functions library="doors.py" label="D" open="20"><door id="a"/></loop_functions>'
    )
    assert spec == LoopSpec(tmp_path / "doors.py", "D", {"open": "20", "door.id": "a"}, 20)
    spec = read_with('<loop_functions library="doors.py" />')
    assert spec is not None
    assert (spec.label, spec.params) == ("", {})


def test_no_loop_functions(read_with: ReadWith) -> None:
    assert read_with("") is None
    assert read_with("<loop_functions />") is None


@pytest.mark.parametrize(
    ("element", "words"),
    [
        ('<loop_functions library="none.py" />', r"'none.py': there is no such file"),
        ('<loop_functions library="mine.c" />', r"'mine.c': expected the path of a .py file"),
        ('<loop_functions label="a" />', r"library: is missing, expected the path of a Python"),
        ('<loop_functions library="" />', r"library: is empty, expected the path of a Python"),
        ('<loop_functions library="broken.py" />', r"broken\.py:2: .*, expected Python"),
        ('<loop_functions library="zero.py" />', r"zero\.py:.*null bytes.*, expected Python"),
        ('<loop_functions library="ok.py"><a b="1"/><a b="2"/></loop_functions>', "b: is there tw"),
        ('<loop_functions library="ok.py" a="x&#10;y"/>', "a: holds a character that is not print"),
    ],
)
def test_what_cannot_be_called_is_refused_at_its_line(
    tmp_path: Path, read_with: ReadWith, element: str, words: str
) -> None:
    (tmp_path / "ok.py").touch()
    (tmp_path / "broken.py").write_text("def reset(world):\n  return (\n")
    (tmp_path / "zero.py").write_bytes(b"\0")
    with pytest.raises(ConfigError, match=rf"^x\.argos:20: <[a-z_]+> .*{words}"):
        read_with(element)


def test_texts_of_elements_are_settings_of_cpp(
    tmp_path: Path, example: str, read_with: ReadWith
) -> None:
    (tmp_path / "mine.cpp").write_text('REGISTER_LOOP_FUNCTIONS(CMine, "mine")\n')
    element = (
        '<loop_functions library="libmine.so" label="mine" tab="a&#9;b">\n one &amp;\n  two'
        "<p k='1'>deep</p><q><!-- no --> late</q></loop_functions>"
    )
    spec = read_with(element)
    assert spec is not None
    expected = ["<loop_functions", "@label=mine", "@library=libmine.so", r"@tab=a\tb", "#one & two"]
    expected += ["<p", "@k=1", "#deep", ">", "<q", ">", ">"]
    assert sorted(spec.settings.splitlines()) == sorted(expected)
    text = example.replace("<arena", f"{element}\n<arena")
    experiment = read(text.encode(), "x.argos", tmp_path / "x.argos")
    told = [words for words in experiment.warnings if "between the elements" in words]
    assert len(told) == 1 and "'late'" in told[0], "ARGoS's parser knows the text at the begin only"
