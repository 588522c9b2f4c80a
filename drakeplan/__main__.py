"""`python -m drakeplan`: the command line."""

import sys

from drakeplan.cli import entry

sys.exit(entry())
