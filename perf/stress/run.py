"""Tries to break fastbeam and prints what happened: case, expected, what happened, ok.

    python perf/stress/run.py                     every part
    python perf/stress/run.py faults precision    only these
    python perf/stress/run.py --quick             fewer repetitions

A part is a module beside this file with a function rows(quick) that yields rows; further modules are found by themselves.
"""
from __future__ import annotations

import argparse
import ast
import importlib
import sys
import time
import traceback
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "src"), str(ROOT / "tests"), str(ROOT / "tests" / "validation")]

from perf.stress.table import Row  # noqa: E402


def parts() -> list[str]:
    """Modules of this folder that define rows()."""
    return [path.stem for path in sorted(Path(__file__).parent.glob("*.py"))
            if any(isinstance(node, ast.FunctionDef) and node.name == "rows" for node in ast.parse(path.read_text()).body)]


def main(arguments: list[str] | None = None) -> int:
    """Runs the named parts; returns the number of rows that are not ok."""
    parser = argparse.ArgumentParser(description="stress tests of fastbeam")
    parser.add_argument("names", nargs="*", help=f"parts to run, default all of: {', '.join(parts())}")
    parser.add_argument("--quick", action="store_true", help="fewer repetitions")
    options = parser.parse_args(arguments)
    unknown = [name for name in options.names if name not in parts()]
    if unknown:
        parser.error(f"no part is called {unknown[0]!r}: choose from {', '.join(parts())}")
    wrong = total = 0
    for name in options.names or parts():
        begin = time.perf_counter()
        print(f"\n{name}\n{Row.head()}")
        found = 0
        try:
            for row in importlib.import_module(f"perf.stress.{name}").rows(quick=options.quick):
                print(row, flush=True)
                found += 1
                wrong += not row.ok
        except Exception:  # one broken part must not hide the others
            traceback.print_exc()
            wrong += 1
        if not found:
            print("  nothing was measured: NO")
            wrong += 1
        total += found
        print(f"  ({time.perf_counter() - begin:.0f} s)")
    print(f"\n{total} rows, {wrong or 'none'} not ok")
    return wrong


if __name__ == "__main__":
    sys.exit(min(main(), 1))
