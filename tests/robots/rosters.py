"""Rosters, and programs that stand for a board's: its daemon, and the ssh that reaches it.

A roster is written from a line for each robot: "root@left tag=23 base=overo".
"""

from __future__ import annotations

from pathlib import Path

from vsense import cli

FILE = "robots.toml"
FAKE_DAEMON = """
case "$1" in
    --version) echo "vsensed 9.9, controller test 0123456789ab" ;;
    --check)
        cat "$3" >"$VSENSED_ROOT/checked"
        [ ! -e "$VSENSED_ROOT/sick" ] || { echo "base     BAD  no answer"; exit 1; }
        echo "base     ok   it answers" ;;
    --identify)
        if grep -q "^watchdog = /dev/none" "$3"; then
            echo "vsensed: $3:5: watchdog: no such device" >&2
            exit 2
        fi
        uid=$(sed -n 's/^uid = //p' "$3")
        echo "${uid:-$(cat "$VSENSED_ROOT/uid" 2>/dev/null || echo "$VSENSED_ROOT" | md5sum |
            cut -c1-32)} from somewhere" ;;
    --config) echo "$$" >"$VSENSED_ROOT/started"; exec sleep 600 ;;
esac
"""
SSH = r"""
while [ "$1" = -o ]; do shift 2; done
echo "$2" >>"$BOARDS/$1.told"
case $1 in
    *off*) echo "ssh: connect to host $1 port 22: No route to host" >&2; exit 255 ;;
    *slow*) echo $$ >"$BOARDS/slow.pid"; exec sleep 600 ;;
esac
export VSENSED_ROOT="$BOARDS/$1"
mkdir -p "$VSENSED_ROOT"
PATH="$BOARDS/$1/bin:$BOARDS/bin:$PATH" exec sh -c "$2"
"""


def write(folder: Path, lines: str) -> Path:
    """Writes a roster; the first word of a line is the host, numbers and true are no texts."""
    tables = []
    for host, *words in (line.split() for line in lines.splitlines() if line.strip()):
        values = [word.partition("=") for word in words]
        own = [f"{name} = {_value(name, value)}" for name, _, value in values]
        tables.append("\n".join(["[[robot]]", f'host = "{host}"', *own, ""]))
    path = folder / FILE
    path.write_text("\n".join(tables))
    return path


def _value(name: str, value: str) -> str:
    plain = value == "true" or (value.isdecimal() and name != "uid")
    return value if plain else f'"{value.replace("~", " ")}"'


def write_program(path: Path, script: str) -> None:
    """Writes a shell script that can be started."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!/bin/sh\n{script}\n")
    path.chmod(0o755)


def deploy(tmp_path: Path, lines: str, *words: str) -> int:
    """Deploys to the robots of a roster with these lines; gives the exit code."""
    write(tmp_path, lines)
    common = ["--host", "10.0.0.1", "--base", "argos:/dev/ttyS0"]
    secure = [] if "--key" in words else ["--insecure"]
    return cli.main(["robot", "deploy", *common, *secure, *words])
