"""The command `vsense`: reads arguments, turns every error into one line and an exit code.

Every module in `vsense/commands` is one command. Exit codes: 0 ok, 1 failed, 2 wrong usage or
input, 130 interrupted. Standard output is data, standard error is talk.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from vsense.errors import VsenseError


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs one command.

    Args:
        arguments: words after `vsense`; by default those of this process.

    Returns:
        The exit code.
    """
    try:
        # Imported here: Ctrl-C while the commands load is as good as later.
        from vsense import commands

        words = sys.argv[1:] if arguments is None else arguments
        options = commands.parser(words).parse_args(words)
        return int(options.run(options))
    except VsenseError as error:
        print(f"vsense: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print("vsense: interrupted", file=sys.stderr)
        return 130
