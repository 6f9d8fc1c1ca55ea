"""The door to the compiled libraries: errors by name, and libraries that know their sources."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tests.rigs.places import ROOT
from vsense.base.native import REBUILD, WireError, check, ffi, kernel_ffi, kernels, lib, stale_files


def checkout(target: Path) -> Path:
    """Copies the files that the libraries were built from."""
    shared = ffi.string(lib.vs_built_from()).decode().splitlines()
    for name in {*shared, *kernel_ffi.string(kernels.vs_built_from()).decode().splitlines()}:
        (target / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, target / name)
    return target


def test_the_libraries_are_built_from_these_sources() -> None:
    assert stale_files(ROOT) == [], f"rebuild it with: {REBUILD}"


SOURCES = ["c_src/vs_wire.h", "c_src/vs_packet.h", "c_src/host/vs_rays.h", "c_src/host/vs_line.h"]
"""Of either library a header that Python sees and one that it does not."""


@pytest.mark.parametrize("source", SOURCES)
def test_a_change_in_any_source_is_noticed(source: str, tmp_path: Path) -> None:
    tree = checkout(tmp_path)
    assert stale_files(tree) == []
    changed = tree / source
    changed.write_text(changed.read_text() + "\n")
    assert source in stale_files(tree)


@pytest.mark.parametrize("source", SOURCES)
def test_a_missing_source_is_named(source: str, tmp_path: Path) -> None:
    tree = checkout(tmp_path)
    (tree / source).unlink()
    assert stale_files(tree) == [source]


def test_an_installed_library_has_nothing_to_compare(tmp_path: Path) -> None:
    assert stale_files(tmp_path) == []


def test_errors_carry_name_code_and_what_was_done() -> None:
    assert check(3) == 3
    with pytest.raises(WireError) as caught:
        check(lib.VS_ERR_TAG, "packet 7")
    assert (caught.value.code, caught.value.name) == (lib.VS_ERR_TAG, "VS_ERR_TAG")
    assert (
        str(caught.value)
        == "packet 7: tag does not match: the packet is damaged, or of another key"
    )
