"""`vsense new`: what it makes loads without a warning, compiles, runs, and is explained."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import require_tool
from tests.rigs.places import ROOT
from vsense import cli
from vsense.base.errors import UsageError
from vsense.config.experiment import load
from vsense.config.specs import Stage
from vsense.robots.build import source_tree
from vsense.tools.shipped import _guide
from vsense.tools.shipped.templates import make, templates


@pytest.mark.parametrize("sensor", [False, True])
@pytest.mark.parametrize("source", templates())
def test_what_is_made_loads_and_is_its_own(source: str, sensor: bool, tmp_path: Path) -> None:
    folder = tmp_path / "mine"
    made = make(folder, source, sensor)
    assert set(made) == set(folder.iterdir())
    experiment = load(made[0], stage=Stage.LAB)
    experiment.refuse_warnings()
    assert experiment.name == "mine"
    used = [*(p for spec in experiment.controllers for p in spec.program.sources)]
    used += [experiment.loop_functions.path] if experiment.loop_functions else []
    assert {path.parent for path in used} == {folder.resolve()}, "nothing is the shipped one's"
    for spec in experiment.controllers:
        assert ("crowd" in [s.sensor.name for s in spec.sensors]) is sensor
    texts = [path.read_text() for path in made]
    assert not re.search(rf"\b{source}\.(argos|py)\b", "".join(texts[:-1]))
    assert f"vsense lab {source}\n" not in texts[0]


@pytest.mark.parametrize("source", templates())
def test_controllers_that_read_the_sensor_compile(source: str, tmp_path: Path) -> None:
    compiler = require_tool("cc", "build-essential")
    controllers = [path for path in make(tmp_path / "mine", source, True) if path.suffix == ".c"]
    assert all('vs_robot_show(robot, "crowd"' in path.read_text() for path in controllers)
    flags = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-fsyntax-only"]
    folders = [f"-I{folder}" for folder in source_tree().includes()]
    subprocess.run([compiler, *flags, *folders, *controllers], check=True)


@pytest.mark.parametrize("source", templates())
def test_the_readme_explains_every_line(source: str, tmp_path: Path) -> None:
    made = make(tmp_path / "mine", source, True)
    argos, readme = made[0].read_text().splitlines(), made[-1].read_text()
    rows = re.findall(r"^\| ([0-9]+)(?: to [0-9]+)? \| `(<[\w:-]+)[^|]*` \| (.*) \|$", readme, re.M)
    assert all(tag in argos[int(line) - 1] for line, tag, _ in rows)
    # What an element holds inside is explained with it.
    inner = {"<body", "<controller", "<dynamics2d", "<led"}
    tags = {tag for text in argos for tag in re.findall(r"^\s*(<[a-z][\w:-]*)", text)}
    assert {tag for _, tag, _ in rows} == tags - inner
    assert [row for row in rows if not row[2].strip()] == []
    calls = re.findall(r"^\| `(vs_\w+)` \| (.+) \|$", readme, re.M)
    used = set(
        re.findall(r"\b(vs_\w+)\(", "".join(p.read_text() for p in made if p.suffix == ".c"))
    )
    assert used == {name for name, _ in calls}
    hooks = {"reset", "pre_step", "post_step", "end"}
    python = "".join(path.read_text() for path in made if path.name == "mine.py")
    assert {h for h in hooks if f"`{h}`: called" in readme} == {
        h for h in hooks if f"def {h}(self, world" in python
    }


def test_every_function_of_the_headers_is_explained() -> None:
    headers = [source_tree().root / "robot" / name for name in ("controller.h", "walk.h")]
    declared = {
        name
        for path in headers
        for name in re.findall(r"^\w.*?\b(vs_\w+)\(", path.read_text(), re.M)
    }
    assert len(declared) > 15
    assert _guide.calls().keys() == declared


def test_it_runs_as_the_readme_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    require_tool("cc", "build-essential")
    monkeypatch.chdir(tmp_path)
    assert cli.main(["new", "mine", "--sensor"]) == 0
    said = capsys.readouterr()
    assert (
        said.out.splitlines()[0] == "mine/mine.argos" and "vsense sim mine/mine.argos" in said.err
    )
    assert cli.main(["sim", "mine/mine.argos", "--duration", "20", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["measures"]["robots_on_spot_mean"] > 0.0


def test_the_controller_in_python_does_what_that_in_c_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    require_tool("cc", "build-essential")
    monkeypatch.chdir(tmp_path)
    measures = []
    for name, options in (("c", ["--sensor"]), ("py", ["--sensor", "--python"])):
        assert cli.main(["new", name, *options]) == 0
        capsys.readouterr()
        assert cli.main(["sim", name, "--duration", "20", "--json", "-o", f"of-{name}"]) == 0
        measures.append(json.loads(capsys.readouterr().out)["measures"])
    assert measures[0] == measures[1]
    with open("of-py/shown.csv") as shown:
        assert "crowd" in shown.read()
    assert (tmp_path / "py" / "py_controller.py").is_file()
    with pytest.raises(UsageError, match="are in C; leave out --from"):
        make(tmp_path / "mine", "foraging", python=True)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["9x"], "'9x': expected a name of letters"),
        (["a b"], "'a b': expected a name"),
        (["x" * 32], "expected a name"),
        ([".."], "'..': expected a name"),
        (["foraging"], "'foraging' is the name of what comes with vsense: choose another one"),
        (["signal"], "'signal' is the name of a module, which Python would not find"),
        (["numpy"], "'numpy' is the name of a module, which Python would not find"),
        (["mine", "--from", "forageing"], "no experiment 'forageing' to begin with; is 'foraging'"),
        (
            ["mine", "--from", "/etc/passwd"],
            "no experiment '/etc/passwd' to begin with; there are:",
        ),
        (["full"], "full is not empty: choose another name"),
        (["file"], "cannot make file: Not a directory"),
        (["file/mine"], "cannot make file/mine: "),
    ],
)
def test_what_cannot_be_made_is_one_line_and_leaves_nothing(
    words: list[str],
    told: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "full").mkdir()
    (tmp_path / "full/theirs").touch()
    (tmp_path / "file").touch()
    before = sorted(tmp_path.rglob("*"))
    assert cli.main(["new", *words]) == 2
    said = capsys.readouterr()
    assert told in said.err and said.err.count("\n") == 1 and said.out == ""
    assert sorted(tmp_path.rglob("*")) == before


def test_an_empty_folder_is_filled_and_a_failure_leaves_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "mine").mkdir()
    assert make(tmp_path / "mine")[0].is_file()

    def full(*arguments: object, **options: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(UsageError, match="other: No space left"):
        make(tmp_path / "other")
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]


@pytest.mark.paced
def test_the_notebook_runs_from_top_to_bottom(tmp_path: Path) -> None:
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    made = make(tmp_path / "mine", notebook=True)
    notebook = nbformat.read(next(path for path in made if path.suffix == ".ipynb"), 4)
    nbformat.validate(notebook)
    where = {"metadata": {"path": str(tmp_path / "mine")}}
    nbclient.NotebookClient(notebook, timeout=100, resources=where).execute()
    shown = [o for cell in notebook.cells for o in cell.get("outputs", ())]
    data = [output.get("data", {}) for output in shown]
    assert [
        o.output_type for o in shown if o.output_type not in ("execute_result", "display_data")
    ] == []
    assert sum("image/png" in one for one in data) == 3
    pages = [str(one["text/html"]) for one in data if "text/html" in one]
    assert "mine.argos" in pages[0] and "image/png;base64," in pages[1]
    assert "<th>0.1</th>" in pages[2] and "4.0" in pages[2]
    assert any("application/vnd.jupyter.widget-view+json" in one for one in data)
    assert any("(True, {'robots_on_spot" in one.get("text/plain", "") for one in data)


def test_its_behaviour_is_tested_for_every_pull_request(tmp_path: Path) -> None:
    yaml = pytest.importorskip("yaml")
    folder = tmp_path / "mine"
    made = make(folder, ci=True)
    names = {str(path.relative_to(folder)) for path in made}
    assert {"test_mine.py", ".gitlab-ci.yml", ".github/workflows/behaviour.yml"} < names
    assert "## test_mine.py\n\nBehaviour test of mine.argos" in made[-1].read_text()
    github = yaml.safe_load((folder / ".github/workflows/behaviour.yml").read_text())
    gitlab = yaml.safe_load((folder / ".gitlab-ci.yml").read_text())["behaviour"]
    steps = github["jobs"]["behaviour"]["steps"]
    assert steps[0]["with"]["fetch-depth"] == 0 and gitlab["variables"]["GIT_DEPTH"] == "0"
    scripts = [step["run"] for step in steps if "run" in step], gitlab["script"]
    for install, test in scripts:
        assert install == 'pip install "$VSENSE" pytest' and test.startswith("pytest ")
    who = ("-c", "user.name=n", "-c", "user.email=e@example.org")
    for words in (("init", "-b", "trunk"), ("add", "."), ("commit", "-m", "begun")):
        subprocess.run(["git", *who, *words], cwd=folder, check=True, capture_output=True)
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OLD": "trunk"}
    environment |= {"PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}  # installed, it is found by itself
    call = [sys.executable, "-m", *scripts[0][1].split(), "-p", "vsense.studies._pytest_plugin"]
    ran = subprocess.run(call, cwd=folder, env=environment, capture_output=True, text=True)
    assert ran.returncode == 0 and "1 passed" in ran.stdout, ran.stdout
    assert list(folder.glob("behaviour/*/compare-mine-*.png"))


def test_only_the_template_has_a_notebook(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="--notebook: there is none about 'foraging'"):
        make(tmp_path / "mine", "foraging", notebook=True)
    with pytest.raises(UsageError, match="--ci: there is none about 'foraging'"):
        make(tmp_path / "mine", "foraging", ci=True)
    words = ["new", str(tmp_path / "mine"), "--notebook", "--ci"]
    assert cli.main(words) == 0
    assert "mine.argos" in (tmp_path / "mine" / "mine.ipynb").read_text()
