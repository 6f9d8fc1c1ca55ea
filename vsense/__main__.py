"""`python -m vsense` is the command `vsense`."""

import sys

from vsense.cli import main

sys.exit(main())
