"""`python -m vsense` is the command `vsense`."""

import sys

if not (sys.flags.isolated or getattr(sys.flags, "safe_path", False)):
    # The current folder; a user's `random.py` or `queue.py` there is none of ours.
    del sys.path[0]

from vsense.cli import main

sys.exit(main())
