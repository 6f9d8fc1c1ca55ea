"""Reads `<loop_functions>`: a Python file whose functions are called around every timestep."""

from __future__ import annotations

from pathlib import Path

from vsense.config import porting
from vsense.config.element import Element
from vsense.config.specs import LoopSpec
from vsense.config.wording import shown

_KNOWN = ("library", "label")


def read_loop_functions(root: Element, folder: Path) -> LoopSpec | None:
    """Reads the loop functions, None where there are none that can be called.

    Args:
        root: <argos-configuration>.
        folder: where a file with a relative path is looked for.

    Raises:
        ConfigError: an attribute is wrong, or the file is not there.
    """
    element = root.optional_child("loop_functions")
    if element is None or not (element.free_attributes() or element.child_names()):
        return None
    library = element.text("library", None, "the path of a Python file")
    label = element.text("label", "") if element.has("label") else ""
    if porting.is_built_for_argos(library):
        port = porting.ported_loop_functions(library, folder)
        if port is None:
            element.leave_out(
                f"{shown(library)} is a C++ library, which is not called; loop functions are"
                f" Python here, see {porting.PAGE}"
            )
            return None
        element.warn(f"library: {shown(library)} is C++: its port {port.name!r} is called instead")
    else:
        port = folder / library
        if port.suffix != ".py" or not port.is_file():
            raise element.error(f"{shown(library)}: expected the path of a .py file", "library")
    _check_syntax(element, port)
    params = collect(element, {})
    return LoopSpec(port, label, {k: v for k, v in params.items() if k not in _KNOWN}, element.line)


def _check_syntax(element: Element, path: Path) -> None:
    """Refuses a file that is no Python, before anything of it is run."""
    try:
        compile(path.read_bytes(), str(path), "exec")
    except SyntaxError as error:
        place = f"{path}:{error.lineno or 1}"
        raise element.error(f"{place}: {error.msg}, expected Python", "library") from None
    except (OSError, ValueError) as error:
        raise element.error(f"{path}: {error}, expected Python", "library") from None


def collect(element: Element, settings: dict[str, str], prefix: str = "") -> dict[str, str]:
    """Flattens the user's own settings: an attribute of a child is called `child.key`.

    Raises:
        ConfigError: two settings have one name, or a value cannot stand in one line.
    """
    for key, value in element.free_attributes().items():
        if any(not character.isprintable() for character in value):
            raise element.error("holds a character that is not printable", key)
        if prefix + key in settings:
            raise element.error("is there twice", key)
        settings[prefix + key] = value
    for child in element.children():
        collect(child, settings, f"{prefix}{child.name}.")
    return settings
