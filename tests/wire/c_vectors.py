"""Turns tests/golden/wire.json into a C header, so that C is held against the same vectors."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from tests.golden.plain_encoder import shown_item

DECLARATIONS = """/* Made from tests/golden/wire.json; do not keep. */
#include "vs_body.h"

struct row { uint8_t id; uint8_t direction; const char *name; const char *layout; };

struct golden {
    const char *name;
    const uint8_t *packet;
    size_t len;
    struct vs_header header;
    const struct row *rows; /* sensor table of the packet, or inside WELCOME */
    size_t row_count;
    const struct vs_hello *hello; /* one of these is not NULL */
    const struct vs_welcome *welcome; /* without its table */
    const struct vs_notice *notice;
    const struct vs_state *state;
    const struct vs_telemetry *telemetry;
};

struct bad {
    const char *name;
    int error;
    const uint8_t *packet;
    size_t len;
    const struct row *rows;
    size_t row_count;
};
"""


def c_bytes(data: bytes) -> str:
    # An array in C cannot be empty; its length is passed separately.
    return "{" + ",".join(map(str, data or b"\0")) + "}"


def c_text(text: str) -> str:
    return '"' + "".join(f"\\{byte:03o}" for byte in text.encode()) + '"'


def c_struct(fields: dict[str, Any]) -> str:
    """A designated initialiser; numbers are unsigned 64 bit unless negative."""
    parts = []
    for name, value in fields.items():
        text = value if isinstance(value, str) else f"{value}{'ULL' if value >= 0 else ''}"
        parts.append(f".{name} = {text}")
    return "{" + ", ".join(parts) + "}"


def state_fields(message: dict[str, Any]) -> dict[str, Any]:
    older = ",".join(f"{older_us}U" for older_us, _ in message["values"])
    payload = b"".join(bytes.fromhex(data) for _, data in message["values"])
    fields = {key: message[key] for key in ("wanted", "from_timestep", "log_heard")}
    fields |= dict(zip(("goal_x_mm", "goal_y_mm", "goal_heading"), message["goal"]))
    return fields | {"older_us": f"{{{older or 0}}}", "payload": c_bytes(payload)}


def message_fields(kind: str, message: dict[str, Any]) -> tuple[str, dict[str, Any]]:
    """The C struct of a packet type and its fields."""
    if kind == "HELLO":
        texts = {key: c_text(message[key]) for key in ("name", "controller", "version", "hash")}
        raw = {key: c_bytes(bytes.fromhex(message[key])) for key in ("uid", "nonce")}
        return "hello", {**message, **texts, **raw}
    if kind == "WELCOME":
        fields = {key: message[key] for key in ("timestep_us", "seed")}
        fields["nonce"] = c_bytes(bytes.fromhex(message["nonce"]))
        params = message["params"].encode()
        # No string: compilers need not take one that is so long.
        text = f"(const char *)(const uint8_t[]){c_bytes(params)}"
        return "welcome", {**fields, "params_len": len(params), "params": text}
    if kind == "STATE":
        return "state", state_fields(message)
    if kind == "TELEMETRY":
        shown = b"".join(shown_item(*item) for item in message["shown"])
        raw = {"payload": c_bytes(bytes.fromhex(message["payload"])), "shown": c_bytes(shown)}
        fields = {**message, **raw, "shown_len": len(shown), "log": c_text(message["log"])}
        return "telemetry", fields
    return "notice", {"code": message["code"], "text": c_text(message["text"])}


class Writer:
    """Collects the header's lines."""

    def __init__(self) -> None:
        self.lines = [DECLARATIONS]
        self.count = 0

    def common(self, vector: dict[str, Any], table: list[list[Any]]) -> tuple[str, str]:
        """Writes packet and table rows; gives the initialisers that refer to them."""
        self.count += 1
        i, packet = self.count, bytes.fromhex(vector["hex"])
        rows = [f"{{{a},{d},{c_text(name)},{c_text(layout)}}}" for a, d, name, layout in table]
        nothing = '{0,0,"",""}'
        self.lines.append(f"static const uint8_t packet_{i}[] = {c_bytes(packet)};")
        self.lines.append(
            f"static const struct row rows_{i}[] = {{{','.join(rows or [nothing])}}};"
        )
        return f"packet_{i}, {len(packet)}", f"rows_{i}, {len(rows)}"

    def golden(self, vector: dict[str, Any]) -> str:
        message = vector["message"]
        packet, rows = self.common(vector, message.get("table", vector["table"]))
        kind, fields = message_fields(vector["type"], message)
        name = f"{kind}_{self.count}"
        self.lines.append(f"static const struct vs_{kind} {name} = {c_struct(fields)};")
        header = c_struct({"type": f"VS_{vector['type']}", **vector["header"]})
        return f"{{{c_text(vector['name'])}, {packet}, {header}, {rows}, .{kind} = &{name}}}"

    def bad(self, vector: dict[str, Any]) -> str:
        packet, rows = self.common(vector, vector["table"])
        return f"{{{c_text(vector['name'])}, {vector['error']}, {packet}, {rows}}}"


def write_vectors(source: Path, target: Path) -> None:
    """Writes the C header.

    Args:
        source: wire.json.
        target: the header.
    """
    vectors = json.loads(source.read_text())
    writer = Writer()
    goldens = [writer.golden(vector) for vector in vectors["packets"]]
    bads = [writer.bad(vector) for vector in vectors["bad"]]
    writer.lines.append("static const struct golden goldens[] = {" + ",\n".join(goldens) + "};")
    writer.lines.append("static const struct bad bads[] = {" + ",\n".join(bads) + "};")
    target.write_text("\n".join(writer.lines) + "\n")
