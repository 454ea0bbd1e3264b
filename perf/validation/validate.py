"""Prints the validation table: quantity, bar, measured value, pass or fail.

    python perf/validation/validate.py                 every check (about three minutes once the kernels are compiled)
    python perf/validation/validate.py bend45 newton   only these
    python perf/validation/validate.py --quick         smaller cases
"""
from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "src")]

from perf.validation import CHECKS, check, misses  # noqa: E402


def main(arguments: list[str] | None = None) -> int:
    """Runs the named checks; returns the number of rows that miss their bar."""
    parser = argparse.ArgumentParser(description="measure every accuracy bar of fastbeam")
    parser.add_argument("names", nargs="*", help=f"checks to run, default all of: {', '.join(CHECKS)}")
    parser.add_argument("--quick", action="store_true", help="smaller cases, as in the test suite")
    options = parser.parse_args(arguments)
    unknown = [name for name in options.names if name not in CHECKS]
    if unknown:
        parser.error(f"no check is called {unknown[0]!r}: choose from {', '.join(CHECKS)}")
    missed = total = 0
    print(f"{'quantity':<108}{'bar':>12}{'measured':>11}")
    for name in options.names or CHECKS:
        begin = time.perf_counter()
        try:
            rows = check(name)(quick=options.quick)
            failed = misses(rows)
        except (ArithmeticError, RuntimeError, ValueError) as error:
            # one broken check must not hide the others
            rows, failed = [], [str(error)]
        print(f"\n{name} ({time.perf_counter() - begin:.0f} s)")
        for row in rows:
            print(f"  {row}")
        if failed and not rows:
            print(f"  FAIL: {failed[0]}")
        missed += len(failed)
        total += max(len(rows), 1)
        sys.stdout.flush()
    print(f"\n{total} rows, {missed} missed" if missed else f"\n{total} rows, none missed")
    return missed


if __name__ == "__main__":
    sys.exit(min(main(), 1))
