"""`python -m drakeplan`: the command line."""

import sys

from drakeplan.cli import main

sys.exit(main())
