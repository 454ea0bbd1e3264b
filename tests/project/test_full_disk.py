"""Files on a disk that is full, at the start or on the way: the error says so, and the process ends as it should. A limit of the
size of files stands for the disk."""
from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = """
import json, resource, signal, sys
import fastbeam as fb
folder, limit = sys.argv[1], int(sys.argv[2])
section = fb.Section(EA=1e4, GA2=4e3, GA3=4e3, GJ=1, EI2=1, EI3=2, rhoA=.2, rhoI2=2e-5, rhoI3=3e-5)
beam = fb.Beam.straight("b", (0, 0, 0), (1.5, 0, 0), section=section, elements=4)
model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), gravity=(0, 0, -9.81)))
shot = {"t_end": 0.9, "step": 1e-3, "every": 1, "snapshots": 900}
run = fb.simulate(model, **shot)
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
found = {}
for name, write in (
        ("run", lambda: fb.simulate(model, file=f"{folder}/w.h5", **shot)),
        ("vtk", lambda: run.to_vtk(f"{folder}/v.vtkhdf")), ("save", lambda: run.save(f"{folder}/v.h5")),
        ("sweep", lambda: fb.sweep(lambda a: {"x": a, "text": "long" * 200}, {"a": list(range(3000))}, workers=1,
                                   file=f"{folder}/s.h5"))):
    try:
        write()
    except fb.ResultFileError as error:
        found[name] = str(error)
print(json.dumps(found))
"""


@pytest.mark.skipif(sys.platform == "win32", reason="no limits of the size of files")
@pytest.mark.parametrize("limit", [100_000, 450_000])
def test_a_full_disk_is_an_error_and_no_crash(limit: int, tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, "-c", PROGRAM, str(tmp_path), str(limit)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found.keys() == {"run", "vtk", "save", "sweep"} and all("File too large" in text for text in found.values())
    assert not (tmp_path / "v.vtkhdf").exists()
