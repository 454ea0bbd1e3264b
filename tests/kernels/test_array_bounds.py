"""Kernels keep within their arrays."""
from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.skipif(sys.platform != "linux", reason="pages are protected by Linux")
@pytest.mark.parametrize("side", ["begin", "end"])
def test_kernels_touch_nothing_outside_of_their_arrays(side: str) -> None:
    script = Path(__file__).parents[1] / "fenced.py"
    done = subprocess.run([sys.executable, str(script), side], capture_output=True, text=True, timeout=600)
    assert done.returncode == 0 and done.stdout.splitlines()[-1] == "done", done.stdout[-300:] + done.stderr[-2000:]
