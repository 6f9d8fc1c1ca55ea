"""What sdist and wheel hold, without building either whole: the sdist is made, and of the wheel all
but the C libraries; this checkout's stand in for those. `test_release.py` does it for real."""

from __future__ import annotations

import email.parser
import json
import re
import shutil
import sys
import tarfile
from email.message import Message
from pathlib import Path

import cv2
import pytest

from tests.packaging.conftest import (
    EXTRAS,
    ROOT,
    clean_environment,
    copy_of_sources,
    pins,
    requirements,
    run,
)
from vsense.base import native
from vsense.robots.build import source_tree

URL = "https://example.org/owner/vsense"


@pytest.fixture(scope="module")
def clone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return copy_of_sources(tmp_path_factory.mktemp("clone") / "tree")


@pytest.fixture(scope="module")
def sdist(clone: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sdist, unpacked."""
    folder = tmp_path_factory.mktemp("sdist")
    environment = clean_environment(folder / "cache", VSENSE_URL=f"{URL}/")
    build = (sys.executable, "-m", "build", "--sdist", "--no-isolation", "--outdir", folder, clone)
    run(*build, env=environment)
    (packed,) = folder.glob("*.tar.gz")
    with tarfile.open(packed) as archive:
        archive.extractall(folder, filter="data")
    return next(path for path in folder.iterdir() if path.is_dir())


@pytest.fixture(scope="module")
def metadata(sdist: Path) -> Message:
    return email.parser.Parser().parsestr((sdist / "PKG-INFO").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def installed(sdist: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder as `site-packages` is with the wheel; the sources that it was made from are gone."""
    folder = tmp_path_factory.mktemp("site-packages")
    tree = shutil.copytree(sdist, folder.parent / "unpacked")
    environment = clean_environment(folder.parent / "cache")
    build = (sys.executable, "setup.py", "-q", "build_py", "--build-lib", folder)
    run(*build, cwd=tree, env=environment)
    shutil.rmtree(tree)
    for library in (ROOT / "vsense").glob("*.so"):
        shutil.copy2(library, folder / "vsense")
    return folder


def test_the_sdist_holds_the_tree_with_its_tests(clone: Path, sdist: Path) -> None:
    def files(tree: Path) -> set[str]:
        paths = [path for path in tree.rglob("*") if path.is_file() and path.suffix != ".pyc"]
        return {str(path.relative_to(tree)) for path in paths}

    made = {name for name in files(sdist) - files(clone) if ".egg-info/" not in name}
    assert made == {"PKG-INFO", "setup.cfg"}
    assert files(clone) - files(sdist) == set()
    assert (sdist / "scripts/test").stat().st_mode & 0o111, "scripts can be called"


def test_the_metadata_are_complete(metadata: Message) -> None:
    assert metadata["License-Expression"] == "MIT" and metadata["License-File"] == "LICENSE"
    assert metadata["Author"] == "the vsense authors" and metadata["Keywords"]
    versions = {
        found[1]
        for line in metadata.get_all("Classifier", [])
        if (found := re.fullmatch(r"Programming Language :: Python :: (3\.\d+)", line))
    }
    assert versions == {f"3.{minor}" for minor in range(10, 15)}
    links = dict(line.split(", ") for line in metadata.get_all("Project-URL", []))
    assert links["Source"] == URL and links["Changelog"].startswith(f"{URL}/blob/v")
    extras = set(metadata.get_all("Provides-Extra", []))
    of_all = next(
        line for line in metadata.get_all("Requires-Dist", []) if line.endswith('extra == "all"')
    )
    named = set(re.findall(r"\[(.*)\]", of_all)[0].split(","))
    assert named == extras - {"all", "bench", "docs", "release", "test"}
    assert named == {*EXTRAS, "robot"}


def test_the_constraints_have_every_dependency_at_a_version_that_is_taken() -> None:
    text = (ROOT / "scripts/constraints.txt").read_text()
    assert "://" not in text, "no index: whoever installs has one"
    pinned = pins()
    assert len(pinned) > 40 and all(str(pin.specifier).startswith("==") for pin in pinned)
    blocks = re.split(r"^(?=[^#\s])", text, flags=re.M)[1:]
    assert len(blocks) == len(pinned)
    assert all("--hash=sha256:" in block for block in blocks)
    for minor in range(10, 15):
        python = {"python_version": f"3.{minor}", "python_full_version": f"3.{minor}.0"}
        here = {p.name: p for p in pinned if p.marker is None or p.marker.evaluate(python)}
        for needed in requirements():
            (version,) = here[needed.name].specifier
            assert needed.specifier.contains(version.version), f"{needed} for 3.{minor}"


def test_links_of_the_description_are_absolute(metadata: Message) -> None:
    text = str(metadata.get_payload())
    links = re.findall(r"(!?)\[[^\]]*\]\(([^)]+)\)", text)
    assert len(links) > 25 and all(target.startswith("https://") for _, target in links)
    pictures = {target for mark, target in links if mark}
    assert pictures and all(target.startswith(f"{URL}/raw/v") for target in pictures)
    for _, target in links:
        place = re.sub(r"^/(?:raw|blob)/v[^/]+/|#.*", "", target.removeprefix(URL))
        assert (ROOT / place).exists(), target


def test_the_readme_begins_with_a_moving_picture() -> None:
    text = (ROOT / "README.md").read_text()
    first = re.search(r"!\[[^\]]+\]\(([^)]+)\)", text)
    assert first is not None and first.start() < text.index("## Try it")
    path = ROOT / first[1]
    assert path.stat().st_size <= 3_000_000
    done, moving = cv2.imreadanimation(str(path))
    assert done and len(moving.frames) > 20 and sum(moving.durations) > 3000
    assert moving.frames[0].shape[1] >= 800


def test_the_package_holds_what_a_checkout_does(installed: Path) -> None:
    package = installed / "vsense"
    held = {str(path.relative_to(package)) for path in package.rglob("*")}
    assert {"py.typed", "config/experiments/start/start.c", "_sources/c_src/vs_session.c"} <= held
    assert not [name for name in held if "/host/" in name], "no robot runs the kernels"
    data = (".argos", ".css", ".html", ".js", ".json", ".md", ".py", ".typed", ".xml", ".xsd")
    ours = {
        str(path.relative_to(ROOT / "vsense"))
        for path in (ROOT / "vsense").rglob("*")
        if path.suffix in data
    }
    assert ours - held == set()
    assert not [name for name in held if name.endswith((".png", ".webp", ".o"))]
    robot = {p for p in (ROOT / "robot").rglob("*") if p.suffix in (".c", ".cpp", ".h", ".hpp")}
    assert {str(p.relative_to(ROOT)) for p in robot} <= {n.removeprefix("_sources/") for n in held}


def test_it_shows_makes_and_runs_without_the_sources(installed: Path, tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    environment = clean_environment(cache) | {"PYTHONPATH": str(installed)}
    script = (
        "import json, sys\n"
        "from vsense import cli, native\n"
        "from vsense.robots import build\n"
        "from vsense.tools.shipped import documents\n"
        "every = {d.name: str(d.path) for d in documents.listed()}\n"
        "daemon = str(build.daemon())\n"
        "codes = [cli.main(words) for words in (['docs', 'sensors'], ['new', 'mine', '--sensor'],\n"
        "         ['sim', 'mine/mine.argos', '--dry'])]\n"
        "print(json.dumps([every, daemon, codes, native.__file__]))\n"
    )
    # Without this checkout, which an editable install puts in the path.
    done = run(sys.executable, "-P", "-c", script, cwd=tmp_path, env=environment)
    every, daemon, codes, module = json.loads(done.stdout.splitlines()[-1])
    assert codes == [0, 0, 0]
    assert all(path.startswith(str(installed)) for path in (*every.values(), daemon, module))
    assert "vsensed" in run(daemon, "--version").stdout
    here = ROOT.as_posix()
    assert here not in done.stdout


def test_an_editable_install_uses_its_tree() -> None:
    # This one is: `scripts/test` has made it.
    assert source_tree().root == ROOT
    assert Path(native.__file__).parents[1] == ROOT / "vsense"
