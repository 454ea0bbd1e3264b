"""The physics tests run the quick forms of the checks that `python perf/validate.py` prints in full."""
from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "perf"))
