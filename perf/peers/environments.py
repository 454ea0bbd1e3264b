"""Makes the environments of the peers under .peers/ (ignored by git): python perf/peers/environments.py [names]

Each peer has its own, with the versions below. OpenSees needs a shared BLAS library: where the system has none
(Debian: libblas3), its environment gets MKL, and links with the expected names.
"""
from __future__ import annotations

import ctypes
import os
import subprocess
import sys
import venv
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / ".peers"
PACKAGES = {"exudyn": ["exudyn==1.13.6", "numpy"], "pyelastica": ["pyelastica==1.0.0"],
            "opensees": ["openseespy==3.7.1.2", "numpy"]}
MODULES = {"exudyn": "exudyn", "pyelastica": "elastica", "opensees": "openseespy.opensees"}
THREADS = {name: "1" for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")}


def interpreter(program: str) -> Path:
    """Python of a program; fastbeam runs in the present one."""
    return Path(sys.executable) if program == "fastbeam" else FOLDER / program / "bin" / "python"


def environment(program: str) -> dict[str, str]:
    """Environment variables of a child process: one thread, and where libraries lie."""
    variables = {**os.environ, **THREADS, "MKL_THREADING_LAYER": "SEQUENTIAL"}
    if program == "fastbeam":
        variables["PYTHONPATH"] = os.pathsep.join(filter(None, (os.environ.get("PYTHONPATH"), str(ROOT / "src"))))
        return variables
    variables.pop("PYTHONPATH", None)
    links = FOLDER / program / "lib" / "blas"
    if links.is_dir():
        variables["LD_LIBRARY_PATH"] = os.pathsep.join((str(links), str(links.parent)))
    return variables


def trouble(program: str) -> str:
    """Why a program cannot run here; empty when it can."""
    if program == "fastbeam":
        return ""
    if not interpreter(program).exists():
        return f"not installed: python perf/peers/environments.py {program}"
    done = subprocess.run([interpreter(program), "-c", f"import {MODULES[program]}"], capture_output=True, text=True,
                          env=environment(program))
    lines = [line for line in done.stderr.strip().splitlines() if "Error" in line]
    return "" if done.returncode == 0 else f"does not start: {lines[0] if lines else 'unknown reason'}"


def has_blas() -> bool:
    """Whether the system has the library that OpenSees is linked to."""
    try:
        ctypes.CDLL("libblas.so.3")
    except OSError:
        return False
    return True


def make(program: str) -> None:
    """Make the environment of one peer and install into it."""
    folder = FOLDER / program
    print(f"making {folder.relative_to(ROOT)}", flush=True)
    venv.create(folder, with_pip=True, clear=True)
    packages = list(PACKAGES[program])
    borrow = program == "opensees" and sys.platform == "linux" and not has_blas()
    if borrow:
        packages.append("mkl")
    subprocess.run([interpreter(program), "-m", "pip", "install", "-q", "--disable-pip-version-check", *packages], check=True)
    if borrow:
        links = folder / "lib" / "blas"
        links.mkdir()
        library = max((folder / "lib").glob("libmkl_rt.so.*"))
        for name in ("libblas.so.3", "liblapack.so.3"):
            (links / name).symlink_to(Path("..") / library.name)


def main() -> int:
    """Make what the command line names; 1 when a peer does not run afterwards."""
    names = sys.argv[1:] or list(PACKAGES)
    unknown = [name for name in names if name not in PACKAGES]
    if unknown:
        raise SystemExit(f"no peer is called {unknown[0]!r}: choose from {', '.join(PACKAGES)}")
    failed = False
    for name in names:
        try:
            make(name)
        except (OSError, subprocess.CalledProcessError) as error:
            print(f"{name}: {error}")
        reason = trouble(name)
        failed |= bool(reason)
        print(f"{name}: {reason or 'ready'}")
    return int(failed)


if __name__ == "__main__":
    raise SystemExit(main())
