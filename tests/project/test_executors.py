"""Sweeps on executors of others: a local cluster of dask, processes of MPI. The same rows, to the last bit, as in one process."""
from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import fastbeam as fb

pytestmark = pytest.mark.slow  # starts clusters
# functions of a module, which other processes can import
BUILD = """
import fastbeam as fb


def build(speed):
    if speed < 0.0:
        raise ValueError("too slow")
    spring = fb.Section.circle(radius=0.02, E=1e6, rho=1000.0)
    rod = fb.Beam.straight("rod", (0, 0, 0), (1, 0, 0), section=spring, elements=2, degree=2)
    return fb.Scene(rod, fb.RigidMotion(velocity=(0, 0, speed), spin=(0, speed, 0)))


def measure(result):
    return {"drift": result.drift("total"), "end": float(result.state.q[2]), "steps": result.info["steps"]}
"""
PROGRAM = """
import json
import fastbeam as fb
from swings import build, measure


def table(executor):
    found = fb.sweep(build, {"speed": [1.0, -1.0, 2.0, 3.0]}, run={"t_end": 0.02, "step": 1e-3}, measure=measure,
                     executor=executor, workers=1 if executor is None else 2, progress=False)
    return json.dumps(found.rows)


if __name__ == "__main__":
    EXECUTOR
"""
DASK = """from distributed import Client, LocalCluster
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster, Client(cluster) as client:
        print(table(client.get_executor()))"""
MPI = """from mpi4py.futures import MPIPoolExecutor
    with MPIPoolExecutor() as pool:
        print(table(pool))"""


def rows(folder: Path, executor: str, *before: str) -> list[dict[str, object]]:
    """What a program with this executor prints."""
    (folder / "swings.py").write_text(BUILD)
    (folder / "program.py").write_text(PROGRAM.replace("EXECUTOR", executor))
    place = os.pathsep.join([str(Path(fb.__file__).parents[1]), str(folder)])
    # in containers MPI runs as root
    allowed = {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"}
    command = [*(before or (sys.executable,)), str(folder / "program.py")]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True,
                          env={**os.environ, **allowed, "PYTHONPATH": place}, timeout=240, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.fixture(scope="module")
def serial(tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, object]]:
    found = rows(tmp_path_factory.mktemp("serial"), "print(table(None))")
    assert [row["error"] is None for row in found] == [True, False, True, True]
    assert found[1]["error"] == "ValueError: too slow" and found[3]["steps"] == 20
    return found


def test_a_local_cluster_of_dask(tmp_path: Path, serial: list[dict[str, object]]) -> None:
    pytest.importorskip("distributed")
    assert rows(tmp_path, DASK) == serial


def test_processes_of_mpi(tmp_path: Path, serial: list[dict[str, object]]) -> None:
    pytest.importorskip("mpi4py")
    beside = Path(sys.executable).parent / "mpiexec"
    start = str(beside) if beside.exists() else shutil.which("mpiexec")
    import_mpi = [sys.executable, "-c", "from mpi4py import MPI"]
    if start is None or subprocess.run(import_mpi, capture_output=True, check=False).returncode:
        pytest.skip("no MPI library")
    said = subprocess.run([start, "--version"], capture_output=True, text=True, check=False).stdout
    many = ["--oversubscribe"] if "Open" in said else []
    assert rows(tmp_path, MPI, start, *many, "-n", "3", sys.executable, "-m", "mpi4py.futures") == serial
