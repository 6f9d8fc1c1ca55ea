"""`vsense pack` and `vsense reproduce` from end to end: simulated, recorded, and changed."""

from __future__ import annotations

import hashlib
import json
import shutil
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import pytest

from tests.run.changed_run import ChangedRun
from vsense import cli
from vsense.base.files import PACKAGE_FOLDER
from vsense.base.message_bus import Message
from vsense.monitor.recording._recorder import Recorder
from vsense.monitor.recording.reader import open_recording
from vsense.monitor.recording.writer import RecordingWriter
from vsense.run.runs_csv import RunRow, RunsFile
from vsense.studies.packages import _archive, _contents
from vsense.studies.packages._archive import MANIFEST, manifest_of
from vsense.studies.packages._places import is_own

LOOP = PACKAGE_FOLDER / "config/experiments/phototaxis.py"

PLAN = """
mode = "sim"
experiment = "foraging"
duration_s = 1
[robots]
count = 2
[[condition]]
name = "sighted"
[[condition]]
name = "blind"
blind = true
[[start]]
name = "drawn"
seed = 7
"""


@pytest.fixture(scope="module")
def packed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A package of a simulated series, whose folder is gone."""
    folder = tmp_path_factory.mktemp("packed")
    (folder / "walks.toml").write_text(PLAN)
    target = folder / "walks.zip"
    assert cli.main(["series", str(folder / "walks.toml")]) == 0
    words = ["pack", str(folder / "walks-sim"), "-o", str(target), "--about", "Two walks."]
    with pytest.MonkeyPatch.context() as smaller:
        smaller.setattr(_contents, "MOST_CONTENTS", 100)
        assert cli.main(words) == 2 and not target.exists(), "nobody could read its contents"
    assert cli.main([*words, "--author", "Josiah Carberry <0000-0002-1825-0097>"]) == 0
    shutil.rmtree(folder / "walks-sim")
    return target


def files_of(path: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(path) as whole:
        return {name: whole.read(name) for name in whole.namelist()}


@pytest.mark.parametrize("named", ["runs.csv", "."])
def test_a_campaigns_table_may_have_a_series_name(
    named: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["foraging", "--robots", "2", "--runs", "1", "--duration", "1"]
    assert cli.main(["sim", *words, "-o", str(tmp_path / "runs.csv")]) == 0
    target = tmp_path / "out" / "walks.zip"
    target.parent.mkdir()
    capsys.readouterr()
    assert (
        cli.main(["pack", str(tmp_path / named), "-o", str(target), "--no-report", "--json"]) == 0
    )
    assert json.loads(capsys.readouterr().out)["lacks"] == [], "simulated again, not recorded"
    assert any("/sources-" in name for name in files_of(target)), "what it was made from"
    assert cli.main(["reproduce", str(target), "-o", str(tmp_path / "again")]) == 0


def test_what_is_kept_is_the_experiments_own_and_open_to_all(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "mine"
    folder.mkdir()
    names = ["map.txt", "private.txt", "../outside.txt", "link"]
    for name in (*names, "remark.txt"):
        (folder / name).write_text(name)
    (folder / "private.txt").chmod(0o600)
    (folder / "link").unlink()
    (folder / "link").symlink_to(tmp_path / "outside.txt")
    text = (PACKAGE_FOLDER / "config/experiments/phototaxis.argos").read_text()
    text = text.replace("</argos-configuration>", "<!-- 'remark.txt' --></argos-configuration>")
    experiment = folder / "mine.argos"
    experiment.write_text(text.replace("phototaxis.py", "loop.py"))
    (folder / "loop.py").write_text(f"{LOOP.read_text()}\nFILES = {names}\n")
    words = ["sim", str(experiment), "--robots", "2", "--duration", "1", "-o"]
    assert cli.main([*words, str(tmp_path / "out")]) == 0
    kept = {name for name in files_of(tmp_path / "out" / "made.zip") if name.startswith("files/")}
    assert kept == {"files/mine.argos", "files/loop.py", "files/map.txt"}
    assert "may not read it: " + str(folder / "private.txt") in capsys.readouterr().err
    experiment.chmod(0o600)
    assert cli.main([*words, str(tmp_path / "closed")]) == 0
    closed = tmp_path / "closed" / "made.zip"
    assert closed.stat().st_mode & 0o777 == 0o600 and "files/mine.argos" in files_of(closed)


def test_series_of_one_name_are_numbered(tmp_path: Path) -> None:
    tables = [tmp_path / name / "results.csv" for name in "abc"]
    tables[0].parent.mkdir()
    words = ["foraging", "--robots", "1", "--runs", "1", "--duration", "1"]
    assert cli.main(["sim", *words, "-o", str(tables[0])]) == 0
    for name in "bc":
        shutil.copytree(tmp_path / "a", tmp_path / name)
    target = tmp_path / "all.zip"
    assert cli.main(["pack", *map(str, tables), "-o", str(target), "--no-report"]) == 0
    folders = {name.partition("/")[0] for name in files_of(target) if "/" in name}
    assert folders == {"results", "results-2", "results-3"}


def repacked(path: Path, into: Path, change: Callable[[str, bytes], bytes]) -> Path:
    """A package with other files, and checksums that are right."""
    files = {name: change(name, data) for name, data in files_of(path).items() if name != MANIFEST}
    sums = {name: hashlib.sha256(data).hexdigest() for name, data in files.items()}
    _archive.write(into, {**files, MANIFEST: manifest_of(sums)})
    return into


def reproduced(
    path: Path, capsys: pytest.CaptureFixture[str], *words: str
) -> tuple[int, Mapping[str, Any]]:
    capsys.readouterr()
    code = cli.main(["reproduce", str(path), "--json", *words])
    out = capsys.readouterr().out
    return code, json.loads(out) if out else {}


def test_a_simulated_series_is_the_same_again_without_anybodys_code(
    packed: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    code, told = reproduced(packed, capsys, "-o", "again")
    assert code == 0 and (told["differs"], told["cannot"]) == (0, 0), told
    things = [one["thing"] for one in told["things"]]
    assert things[:2] == [f"walks-sim/run-00{n}: row of walks-sim/runs.csv" for n in (1, 2)]
    assert {"report/report.html", "report/runs-01-items_home.svg"} <= set(things)
    assert (tmp_path / "again" / "anew" / "report" / "report.html").is_file()
    assert cli.main(["reproduce", str(packed), "-o", "again"]) == 2
    assert "is not empty" in capsys.readouterr().err


def test_a_changed_byte_is_named_and_nothing_is_made(
    packed: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "other.zip"
    files = files_of(packed)
    table = files["walks-sim/runs.csv"]
    _archive.write(other, {**files, "walks-sim/runs.csv": table[:-3] + b"9" + table[-2:]})
    assert cli.main(["reproduce", str(other), "-o", str(tmp_path / "out")]) == 1
    err = capsys.readouterr().err
    assert "is not what was packed: walks-sim/runs.csv has changed" in err
    assert not (tmp_path / "out").exists()


def test_the_description_is_an_ro_crate_of_all_files(packed: Path) -> None:
    """Source: RO-Crate 1.1, sections 2 to 5; its validator was tried by hand."""
    files = files_of(packed)
    crate = json.loads(files["ro-crate-metadata.json"])
    assert crate["@context"][0] == "https://w3id.org/ro/crate/1.1/context"
    entities = {entity["@id"]: entity for entity in crate["@graph"]}
    assert len(entities) == len(crate["@graph"]), "an id names one entity"
    descriptor, root = entities["ro-crate-metadata.json"], entities["./"]
    assert descriptor["about"] == {"@id": "./"} and descriptor["@type"] == "CreativeWork"
    assert descriptor["conformsTo"] == {"@id": "https://w3id.org/ro/crate/1.1"}
    assert root["@type"] == "Dataset" and root["description"] == "Two walks."
    assert root["author"] == {"@id": "https://orcid.org/0000-0002-1825-0097"}
    assert len(root["datePublished"]) == 10 and root["license"]["@id"] in entities
    parts = {unquote(part["@id"]) for part in root["hasPart"]}
    assert parts == files.keys() - {"ro-crate-metadata.json", MANIFEST}
    for name in parts:
        entity = entities[name]
        assert entity["@type"] == "File" and entity["encodingFormat"].count("/") == 1
        assert entity["contentSize"] == str(len(files[name]))
        assert entity["sha256"] == hashlib.sha256(files[name]).hexdigest()
    action = entities["#made-walks-sim"]
    assert action["@type"] == "CreateAction"
    assert entities[action["instrument"]["@id"]]["@type"] == "SoftwareApplication"
    linked = [link for value in action.values() if isinstance(value, list) for link in value]
    assert linked and all(link["@id"] in entities for link in linked)


def spying(trace: Path) -> Callable[[str, bytes], bytes]:
    """A package with an experiment of its own, whose code leaves a trace, and a better result."""
    future = b"from __future__ import annotations\n"
    spy = future + f"open({str(trace)!r}, 'w').close()\n".encode()

    def change(name: str, data: bytes) -> bytes:
        if name.endswith("made.json"):
            told = json.loads(data)
            for setup in told["setups"].values():
                setup["experiment"] = f"@package/{name.rpartition('/')[0]}/{ARGOS}"
            return json.dumps(told).encode()
        if name == "vsense-package.json":
            return json.dumps({**json.loads(data), "report": []}).encode()
        if name == "walks-sim/runs.csv":
            lines = data.decode().splitlines()
            cells = lines[1].split(",")
            cells[lines[0].split(",").index("items_home")] = "2"
            return "\n".join([lines[0], ",".join(cells), *lines[2:], ""]).encode()
        return data.replace(future, spy) if name.endswith("foraging.py") else data

    return change


def test_code_of_others_is_run_only_for_who_trusts_it_and_results_are_compared(
    packed: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Whoever changes a result can compute checksums anew, but no simulation."""
    trace = tmp_path / "trace"
    other = repacked(packed, tmp_path / "other.zip", spying(trace))
    code, told = reproduced(other, capsys)
    why = [one["words"] for one in told["things"] if one["verdict"] == "cannot"]
    assert code == 3 and len(why) == 2 and all("--trust" in words for words in why)
    assert not trace.exists()
    code, told = reproduced(other, capsys, "--trust")
    first, second = told["things"]
    assert code == 1 and trace.exists() and second["verdict"] == "same"
    assert first["thing"] == "walks-sim/run-001: row of walks-sim/runs.csv"
    assert first["words"] == "items_home: 2 before, now 0 (by 2)"


ARGOS = "vsense/config/experiments/foraging.argos"


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run in the lab, as far as it follows from its recording."""
    folder = tmp_path_factory.mktemp("recorded") / "lab"
    folder.mkdir()
    run = ChangedRun()
    recorder = Recorder(run.bus, folder / "foraging.mcap")
    run.live(30, {})
    recorder.close()
    tags = sorted(run.robots)
    row = RunRow(run="run-1", mode="lab", experiment="foraging", condition="sighted", seed=5,
                 tags=tags, robots=len(tags), note=f"of {Path.home()}",
                 measures=run.environment.world.results)  # fmt: skip
    RunsFile(folder / "runs.csv").append(row)
    (folder / "robots").mkdir()
    (folder / "robots" / "31.key").write_text("secret of 31")
    (folder / "log.txt").write_text(f"{Path.home()}/x: robot 31 at root@192.168.1.30\n")
    return folder


def test_a_recorded_run_is_sensed_again_and_says_what_it_lacks(
    recorded: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    target = tmp_path / "lab.zip"
    assert cli.main(["pack", str(recorded), "-o", str(target), "--no-report", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["lacks"] == [
        "lab/foraging.mcap: has no pictures (--record-images): poses cannot be tracked again",
        "lab: what its runs were made from was not kept (by a vsense before packages):"
        " simulated runs cannot be made again",
    ]
    files = files_of(target)
    assert files["lab/log.txt"] == b"~/x: robot 31 at USER@HOST\n"
    assert not any(name.endswith(".key") for name in files)
    assert not any(str(Path.home()).encode() in data for data in files.values())
    again = tmp_path / "again.zip"
    assert cli.main(["pack", str(recorded), "-o", str(again), "--no-report"]) == 0
    assert again.read_bytes() == target.read_bytes(), "the same runs are the same bytes"
    code, told = reproduced(target, capsys)
    verdicts = {one["thing"]: one["verdict"] for one in told["things"]}
    assert code == 3 and verdicts == {
        "lab/foraging.mcap: poses": "cannot",
        "lab/foraging.mcap: readings": "same",
        "lab/run-1: row of lab/runs.csv": "same",
    }, told


def test_a_packed_recording_names_nobody(recorded: Path, tmp_path: Path) -> None:
    target = tmp_path / "lab.zip"
    assert cli.main(["pack", str(recorded), "-o", str(target), "--no-report"]) == 0
    copy = tmp_path / "copy.mcap"
    copy.write_bytes(files_of(target)["lab/foraging.mcap"])
    with open_recording(copy) as now, open_recording(recorded / "foraging.mcap") as before:
        assert now.experiment["made"]["path"] == "@vsense/experiments/foraging.argos"
        for topic in ("/arena", "/readings", "/deeds"):
            kept, was = (list(one.messages({topic})) for one in (now, before))
            assert kept == was and len(kept) > 20
    assert str(Path(cli.__file__).parent).encode() not in copy.read_bytes()


SHIPPED = PACKAGE_FOLDER / "config" / "experiments"


@pytest.fixture
def traps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The file that shows that code beside a package has run, in the current folder as a paper's
    supplement is unpacked there: experiments of somebody's, one called as a shipped one."""
    trace, here = tmp_path / "trace", tmp_path / "supplement"
    future = "from __future__ import annotations\n"
    code = (SHIPPED / "foraging.py").read_text()
    code = code.replace(future, f"{future}open({str(trace)!r}, 'w').close()\n")
    text = (SHIPPED / "foraging.argos").read_text().replace("foraging.py", "evil.py")
    for folder in (here, here / "@vsense" / "experiments"):
        folder.mkdir(parents=True)
        (folder / "evil.py").write_text(code)
        for name in ("evil", "foraging"):
            (folder / f"{name}.argos").write_text(text)
    monkeypatch.chdir(here)
    return trace


EVIL = (
    *("evil.argos", "foraging.argos", "./evil.argos", "./foraging", "../supplement/evil.argos"),
    *("@vsense/experiments/evil.argos", "@vsense/experiments/evil", "@vsense/evil.argos"),
    "@vsense/experiments/../../evil.argos",
)
"""What a package may say that its experiment is."""


@pytest.mark.parametrize("name", [*EVIL, "whole"])
def test_nothing_but_a_shipped_experiment_is_vsenses_own(
    name: str, packed: Path, traps: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    said = str(Path("evil.argos").absolute()) if name == "whole" else name

    def change(file: str, data: bytes) -> bytes:
        if file == "vsense-package.json":
            return json.dumps({**json.loads(data), "report": []}).encode()
        if not file.endswith("made.json"):
            return data
        told = json.loads(data)
        for setup in told["setups"].values():
            setup["experiment"] = said
        return json.dumps(told).encode()

    other = repacked(packed, tmp_path / "other.zip", change)
    code, told = reproduced(other, capsys)
    why = [one["words"] for one in told["things"]]
    assert code == 3 and not traps.exists() and all("--trust" in words for words in why), told
    code, told = reproduced(other, capsys, "--trust")
    if said[0] not in "/@":  # who believes a package does not believe the current folder
        why = [one["words"] for one in told["things"]]
        assert code == 3 and not traps.exists() and all("a whole path" in words for words in why)


def test_a_shipped_experiments_name_is_vsenses_own_wherever_one_is(
    packed: Path, traps: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def change(file: str, data: bytes) -> bytes:
        path = b'"@vsense/experiments/foraging.argos"'
        return data.replace(path, b'"foraging"') if file.endswith("made.json") else data

    for other in (packed, repacked(packed, tmp_path / "other.zip", change)):
        code, told = reproduced(other, capsys)
        assert code == 0 and not traps.exists(), told


@pytest.mark.parametrize(
    "setting",
    [
        {f"foraging.{name}": f"evil.{suffix}"}
        for name in ("params.what", "nest")
        for suffix in ("py", "lua", "c", "cc", "cpp", "cxx", "h", "so", "argos", "xml", "png")
    ]
    + [{f"e.{name}": "evil"} for name in ("library", "label", "file", "vs:sources", "vs:include")]
    + [{"e.noise": words} for words in ("a/b", "a\\b", "..", "~a", "*", "@package")],
    ids=str,
)
def test_settings_that_may_name_code_are_not_vsenses_own(setting: dict[str, str]) -> None:
    assert is_own("foraging", {"settings": {"sensor.noise": "0.25", "e.kind": "bright"}})
    assert not is_own("foraging", {"settings": setting})


def reexperimented(path: Path, into: Path, first: Mapping[str, Any], every: bool) -> Path:
    """A recording that says something else of its experiment first, or always."""
    seen: list[Message] = []

    def change(message: Message) -> Message:
        if message.topic != "/experiment" or (seen and not every):
            return message
        seen.append(message)
        made = {**message.data["made"], **first["made"]}
        return replace(message, data={**message.data, **first, "made": made})

    with open_recording(path) as recording:
        messages = [m for m in recording.messages() if not m.topic.startswith("/foxglove")]
        writer = RecordingWriter(into, recording.begin_ns, recording.utc_shift_ns)
        experiment = next(m for m in messages if m.topic == "/experiment")
        for message in [experiment, *messages]:
            writer.add(change(message))
        writer.close()
    return into


@pytest.mark.parametrize("every", [True, False], ids=["always", "first"])
@pytest.mark.parametrize("where", ["evil.argos", "@vsense/experiments/foraging.argos"])
def test_a_recordings_experiment_is_believed_as_little(
    where: str, every: bool, recorded: Path, traps: Path, tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    """Also where the one that the recording has last is vsense's own."""
    target = tmp_path / "lab.zip"
    assert cli.main(["pack", str(recorded), "-o", str(target), "--no-report"]) == 0
    before, after = tmp_path / "before.mcap", tmp_path / "after.mcap"
    before.write_bytes(files_of(target)["lab/foraging.mcap"])
    text = Path("evil.argos").read_text().replace('"evil.py"', f'"{Path("evil.py").absolute()}"')
    Path("evil.argos").write_text(text)
    said = {"file_text": text, "made": {"path": where, "casting": {"limit": 9}}}
    data = reexperimented(before, after, said, every).read_bytes()
    other = repacked(
        target, tmp_path / "other.zip", lambda n, d: data if n == "lab/foraging.mcap" else d
    )
    code, told = reproduced(other, capsys)
    (why,) = (one["words"] for one in told["things"] if one["thing"].endswith("readings"))
    assert code == 3 and not traps.exists() and "--trust" in why, told


def test_a_recording_of_a_relative_path_is_sensed_again_from_where_one_says_only(
    recorded: Path, traps: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "other.mcap"
    text = Path("evil.argos").read_text()
    said = {"file_text": text, "made": {"path": "evil.argos"}}
    reexperimented(recorded / "foraging.mcap", other, said, True)
    assert cli.main(["replay", str(other), "--resense"]) == 2
    assert "--experiment FILE" in capsys.readouterr().err and not traps.exists()
