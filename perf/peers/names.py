"""Tries the names and the program of docs/coming-from.md that are Exudyn's: python perf/peers/names.py

It runs in Exudyn's environment (`python perf/peers/environments.py exudyn`): every name in the column of the page is looked
up, and the program that the page shows is run as it stands there. The other three programs are on no registry that pip reads
(MBDyn, cardillo), or under their name stands something else (pychrono); their names were looked up in public copies of their
sources.
"""
from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "coming-from.md"
INSIDE = """
import sys
import exudyn as exu
import exudyn.beams
import exudyn.utilities
from exudyn.beams import *
from exudyn.utilities import *

SC = exu.SystemContainer()
mbs = SC.AddSystem()
places = [exu, exudyn.utilities, exudyn.beams, mbs, SC, exu.BeamSection(), exudyn.utilities.ObjectJointSliding()]
missing = [name for name in NAMES if not any(hasattr(place, name) for place in places)]
print("missing:", missing)
rhoA, EI, EA = 1200.0 * 0.03**2, 2.1e9 * 0.03**4 / 12.0, 2.1e9 * 0.03**2
exu.config.printToConsole = False
PROGRAM
place = mbs.GetNodeOutput(node, exu.OutputVariableType.Position)
exu.config.printToConsole = True
print(f"x = {place[0]:.4f} m, y = {place[1]:.4f} m")
"""


def names() -> list[str]:
    """Names in the column of Exudyn."""
    out: list[str] = []
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.split("|")]
        if len(cells) > 4 and cells[1] != "here" and not cells[1].startswith("---"):
            for code in re.findall(r"`([^`]+)`", cells[2]):
                out += [name for name in re.findall(r"[A-Za-z]\w+", code) if name != "mbs" and name != "SC"]
    return list(dict.fromkeys(out))


def main() -> int:
    """1 where a name is missing or the program fails."""
    sys.path.insert(0, str(ROOT))
    from perf.peers.environments import environment, interpreter, trouble
    reason = trouble("exudyn")
    if reason:
        print(f"exudyn: {reason}")
        return 1
    program = next(x for x in re.findall(r"~~~ text\n(.*?)~~~", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL) if "mbs" in x)
    unknown = [name for name in names() if name != "simulationSettings"]
    text = INSIDE.replace("NAMES", repr(unknown)).replace("PROGRAM", program)
    done = subprocess.run([interpreter("exudyn"), "-c", text], capture_output=True, text=True, env=environment("exudyn"),
                          check=False)
    print(f"{len(unknown)} names of Exudyn")
    print(done.stdout, done.stderr[-2000:], sep="")
    return int(done.returncode != 0 or "missing: []" not in done.stdout)


if __name__ == "__main__":
    raise SystemExit(main())
