"""Every bar of the cost of sliding contact, with its value: sliders.py, friction.py, sleeves.py and net_sliders.py, one
after the other, each in a process of its own.

    python perf/cases/slider_bars.py            a quarter of an hour, most of it kernels that are compiled the first time
    python perf/cases/slider_bars.py --quick    fewer sliders, no net

Exits with 1 where a bar is missed.
"""
from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
WHOLE = {"sliders.py": ["--counts", "16", "64", "256", "4096"], "friction.py": [], "sleeves.py": ["--counts", "16"],
         "net_sliders.py": ["--threads", "1"]}
QUICK = {"sliders.py": ["--counts", "16", "256", "--degrees", "2"], "friction.py": ["--counts", "16"],
         "sleeves.py": ["--counts", "4"]}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true")
    given = parser.parse_args()
    missed = 0
    for name, options in (QUICK if given.quick else WHOLE).items():
        print(f"--- {name} {' '.join(options)}", flush=True)
        missed |= subprocess.run([sys.executable, str(HERE / name), *options]).returncode
    return int(missed > 0)


if __name__ == "__main__":
    sys.exit(main())
