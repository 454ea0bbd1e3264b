"""The test suite with a plugin that writes one line a test, or a comparison, as JSON (test_times.py, test_margins.py)."""
from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def written(plugin: str) -> Path:
    """Where a plugin writes its lines."""
    return ROOT / "out" / f"{plugin}.jsonl"


def main(plugin: str, table: Callable[..., None], *options: str) -> int:
    """Run pytest with the plugin and the arguments of the command line, or read runs before (--of); then print the table."""
    arguments, out = sys.argv[1:], written(plugin)
    if arguments[:1] == ["--of"]:
        table(*map(Path, arguments[1:]))
        return 0
    out.parent.mkdir(exist_ok=True)
    out.unlink(missing_ok=True)
    paths = os.pathsep.join([str(ROOT), str(ROOT / "src"), os.environ.get("PYTHONPATH", "")])
    with tempfile.TemporaryDirectory() as fresh:  # asserts are compiled once more, with the hooks of the plugin
        environment = {**os.environ, "PYTHONPATH": paths, "PYTHONPYCACHEPREFIX": fresh}
        code = subprocess.run([sys.executable, "-m", "pytest", "-q", "-p", f"perf.suite.{plugin}", "-n", "2", "--dist",
                               "loadfile", "--no-loadscope-reorder", *options, *arguments], cwd=ROOT, env=environment).returncode
    table(out)
    return code
