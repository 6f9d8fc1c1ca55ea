"""A package's description as an RO-Crate 1.1: JSON-LD that repositories and search engines read.

Source: https://www.researchobject.org/ro-crate/specification/1.1/
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any
from urllib.parse import quote

from vsense.base.errors import UsageError
from vsense.base.terminal import counted
from vsense.modes import origin
from vsense.studies.packages._contents import PackageContents
from vsense.studies.packages._gathering import FoundSeries

METADATA = "ro-crate-metadata.json"
_CONTEXT = "https://w3id.org/ro/crate/1.1/context"
_PROFILE = "https://w3id.org/ro/crate/1.1"
_OWN_TERMS = {"sha256": "https://schema.org/sha256"}
"""Which the context of RO-Crate 1.1 does not have yet."""
_NO_LICENSE = "#no-license"
_ORCID = "https://orcid.org/"
_LIBRARIES = {
    "NumPy": "https://numpy.org/",
    "OpenCV": "https://opencv.org/",
    "Python": "https://www.python.org/",
}

CrateEntity = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Described:
    """A file: its name in the package, what it is, its media type, size [byte] and checksum."""

    name: str
    title: str
    about: str
    media: str
    size: int = 0
    sha256: str = ""


@dataclass(frozen=True, slots=True)
class Person:
    """Somebody, with their ORCID iD, "": not said."""

    name: str
    orcid: str = ""

    @property
    def id(self) -> str:
        """What the description knows them by."""
        return f"{_ORCID}{self.orcid}" if self.orcid else f"#{quote(self.name)}"


@dataclass(frozen=True, slots=True)
class Title:
    """What is said of a package as a whole; `license` is an address, an SPDX name or "", `date`
    its day, as ISO 8601."""

    name: str
    about: str
    authors: Sequence[Person]
    license: str
    date: str


def person(text: str) -> Person:
    """Reads "NAME" or "NAME <ORCID>".

    Raises:
        ValueError: it is neither, or the iD is not one; the message says what was expected.
    """
    match = re.fullmatch(r"\s*([^<>]*[^<>\s])\s*(?:<([^<>]*)>)?\s*", text)
    if match is None or not match[1].isprintable():
        raise ValueError(f"expected NAME or 'NAME <ORCID>', got {text[:60]!r}")
    orcid = (match[2] or "").strip().removeprefix(_ORCID)
    if orcid and not _is_orcid(orcid):
        raise ValueError(f"{orcid[:40]!r} is no ORCID iD, such as 0000-0002-1825-0097")
    return Person(match[1], orcid)


def _is_orcid(text: str) -> bool:
    """Whether its check digit is right. Source: ISO/IEC 7064, MOD 11-2."""
    if re.fullmatch(r"(\d{4}-){3}\d{3}[\dX]", text) is None:
        return False
    total = 0
    for digit in text.replace("-", "")[:-1]:
        total = 2 * (total + int(digit))
    return text[-1] == "0123456789X"[(12 - total % 11) % 11]


def license_of(text: str) -> str:
    """The address of a licence, from an address or an SPDX name; ValueError if it is neither."""
    if re.fullmatch(r"https?://[^\s<>\"]+", text):
        return text
    if re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9.+-]*", text):
        return f"https://spdx.org/licenses/{text}"
    raise ValueError(f"expected an address, or a name of SPDX such as CC-BY-4.0, got {text!r}")


def describe(
    title: Title,
    files: Sequence[Described],
    origins: Mapping[str, origin.RunOrigin],
    all_series: Sequence[FoundSeries],
) -> bytes:
    """The description.

    Args:
        files: all of the package but this and the manifest.
        origins: what runs were made from, by its folder in the package.
        all_series: the runs.
    """
    if not files:
        raise UsageError("a package needs a file")
    software = _software(origins)
    actions = [_action(title, series, files, software) for series in all_series]
    graph = [
        _descriptor(),
        _root(title, files, actions),
        *_people(title),
        _license(title),
        *(_file(file) for file in files),
        *software,
        *actions,
    ]
    text = json.dumps({"@context": [_CONTEXT, _OWN_TERMS], "@graph": graph}, indent=1)
    return f"{text}\n".encode()


def _refs(ids: Sequence[str]) -> CrateEntity | list[CrateEntity]:
    """Links to entities; a single one stands by itself, as RO-Crate 1.1 wants it."""
    links = [{"@id": id} for id in ids]
    return links[0] if len(links) == 1 else links


def _ids(entities: Sequence[CrateEntity]) -> list[str]:
    return [entity["@id"] for entity in entities]


def _id(name: str) -> str:
    """A file's name as a relative address."""
    return quote(name, safe="/")


def _descriptor() -> CrateEntity:
    return {
        "@id": METADATA,
        "@type": "CreativeWork",
        "conformsTo": {"@id": _PROFILE},
        "about": {"@id": "./"},
    }


def _root(title: Title, files: Sequence[Described], actions: Sequence[CrateEntity]) -> CrateEntity:
    root: CrateEntity = {
        "@id": "./",
        "@type": "Dataset",
        "name": title.name,
        "description": title.about,
        "datePublished": title.date,
        "license": {"@id": title.license or _NO_LICENSE},
        "hasPart": _refs([_id(file.name) for file in files]),
        "mentions": _refs(_ids(actions)),
    }
    if title.authors:
        root["author"] = _refs([author.id for author in title.authors])
    return root


def _people(title: Title) -> list[CrateEntity]:
    return [{"@id": author.id, "@type": "Person", "name": author.name} for author in title.authors]


def _license(title: Title) -> CrateEntity:
    if not title.license:
        words = "It is not said what others may do with this package."
        return {
            "@id": _NO_LICENSE,
            "@type": "CreativeWork",
            "name": "No licence",
            "description": words,
        }
    name = title.license.rstrip("/").rpartition("/")[2]
    about = f"The licence of this package: {title.license}"
    kind = {"@id": title.license, "@type": "CreativeWork"}
    return {**kind, "name": name, "description": about}


def _file(file: Described) -> CrateEntity:
    return {
        "@id": _id(file.name),
        "@type": "File",
        "name": f"{file.title}: {file.name}",
        "description": file.about,
        "encodingFormat": file.media,
        "contentSize": str(file.size),
        "sha256": file.sha256,
    }


def _software(origins: Mapping[str, origin.RunOrigin]) -> list[CrateEntity]:
    programs: dict[str, CrateEntity] = {}
    for source in origins.values():
        needs = []
        for name, address in _LIBRARIES.items():
            if version := source.about.get(name) or source.machine.get(name):
                needs.append(_program(name, version, address))
        if compiler := source.about.get("compiler"):
            needs.append(_program("C compiler", compiler, ""))
        own = _program("vsense", source.machine.get("vsense", ""), "")
        own["description"] = "Virtual sensing for real robot swarms, and its simulation."
        own["softwareRequirements"] = _refs(_ids(needs))
        if system := source.about.get("system"):
            own["operatingSystem"] = system
        programs |= {program["@id"]: program for program in needs}
        programs.setdefault(own["@id"], own)
    return list(programs.values())


def _program(name: str, version: str, address: str) -> CrateEntity:
    entity: CrateEntity = {
        "@id": f"#{quote(f'{name} {version}'.strip())}",
        "@type": "SoftwareApplication",
        "name": name,
        "softwareVersion": version,
    }
    return {**entity, "url": address} if address else entity


def _action(
    title: Title,
    series: FoundSeries,
    files: Sequence[Described],
    software: Sequence[CrateEntity],
) -> CrateEntity:
    """How the files of a series came to be."""
    inside = [file.name for file in files if file.name.startswith(f"{series.name}/")]
    sources = [name for name in inside if name.split("/")[1].startswith("sources-")]
    modes = sorted({run.facts.mode for run in series.runs})
    began = sorted(filter(None, (run.facts.began for run in series.runs)))
    experiments = sorted({run.facts.experiment for run in series.runs})
    action: CrateEntity = {
        "@id": f"#made-{quote(series.name)}",
        "@type": "CreateAction",
        "name": f"{counted(len(series.runs), 'run')} of {', '.join(experiments)}"
        f" ({', '.join(modes)})",
        "description": f"The runs of {series.name}, made with vsense {', '.join(modes)}.",
        "object": _refs([_id(name) for name in sources]),
        "result": _refs([_id(name) for name in inside if name not in sources]),
        "instrument": _refs(_ids([program for program in software if program["name"] == "vsense"])),
    }
    action = {name: value for name, value in action.items() if value}
    if began:
        action["startTime"] = began[0]
    if title.authors:
        action["agent"] = _refs([author.id for author in title.authors])
    return action


def readme(name: str, contents: PackageContents, all_series: Sequence[FoundSeries]) -> str:
    """A package in words, for whoever opens it without vsense."""
    lines = [f"# {name}", "", "Runs of robot swarms, packed by vsense. In it:", ""]
    for series in all_series:
        modes = ", ".join(sorted({run.facts.mode for run in series.runs}))
        lines.append(f"* `{series.name}/`: {counted(len(series.runs), 'run')} ({modes})")
    if contents.report:
        lines.append("* `report/`: figures and tests, made of the tables and recordings here")
    lines += [
        "",
        "`sha256sum -c manifest-sha256.txt` checks all files. With vsense installed,",
        "`vsense reproduce PACKAGE.zip` checks them as well, and makes everything again:",
        "simulated runs are simulated, recordings sensed and tracked again, figures drawn.",
        "",
        "Paths that begin with `@package` are of this package, with `@vsense` of vsense.",
    ]
    if contents.left_out:
        out = ", ".join(f"{what} ({count})" for what, count in contents.left_out.items())
        lines += ["", f"Left out or replaced: {out}."]
    if contents.lacks:
        lines += ["", "What is missing:", "", *(f"* {words}" for words in contents.lacks)]
    return "\n".join([*lines, ""])
