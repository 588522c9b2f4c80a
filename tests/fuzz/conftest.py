"""The fuzzers are programs of their own, started as `python tests/fuzz`; tests import their modules by the same names."""

import sys
from pathlib import Path

HERE = str(Path(__file__).parent)
if HERE not in sys.path:
    sys.path.insert(0, HERE)
