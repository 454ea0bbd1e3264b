"""Wheel and source archive hold what they should, and the wheel runs where the source tree is not."""
from __future__ import annotations

import os
import subprocess
import sys
import sysconfig
import tarfile
import venv
import zipfile
from pathlib import Path

import pytest

import fastbeam as fb

ROOT = Path(__file__).resolve().parents[2]
pytestmark = pytest.mark.slow  # builds packages


def run(*command: str, where: Path) -> str:
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"} | {"FASTBEAM_PROGRESS": "0"}
    done = subprocess.run(command, cwd=where, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def packages(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The source archive, and the wheel made of it."""
    pytest.importorskip("build")
    pytest.importorskip("hatchling")
    out = tmp_path_factory.mktemp("dist")
    run(sys.executable, "-m", "build", "--no-isolation", "--outdir", str(out), str(ROOT), where=out)
    (archive,), (wheel,) = out.glob("*.tar.gz"), out.glob("*.whl")
    return archive, wheel


def test_the_wheel_holds_the_package_the_examples_and_the_license(packages: tuple[Path, Path]) -> None:
    with zipfile.ZipFile(packages[1]) as wheel:
        names = set(wheel.namelist())
        metadata = wheel.read(next(name for name in names if name.endswith("METADATA"))).decode()
    sources = {path.relative_to(ROOT / "src").as_posix() for path in (ROOT / "src" / "fastbeam").rglob("*.py*")
               if "__pycache__" not in path.parts}
    assert sources - names == set()
    assert "fastbeam/examples/crane.py" in names and "fastbeam/py.typed" in names
    assert any(name.endswith("licenses/LICENSE") for name in names)
    assert "License-Expression: MIT" in metadata and f"Version: {fb.__version__}" in metadata and "# fastbeam" in metadata
    assert [name for name in names if name.startswith(("tests", "perf"))] == []


def test_the_archive_holds_tests_and_pages(packages: tuple[Path, Path]) -> None:
    with tarfile.open(packages[0]) as archive:
        names = {name.split("/", 1)[1] for name in archive.getnames() if "/" in name}
    wanted = {"pyproject.toml", "README.md", "LICENSE", "CHANGELOG.md", "CONTRIBUTING.md", "CITATION.cff", "docs/theory.md",
              "tests/naive.py", "src/fastbeam/dynamics/time_loop.py", "Makefile"}
    assert wanted - names == set()
    data = "docs/reports/study/data"
    assert [name for name in names if name.startswith(("out/", ".venv", data))] in ([], [f"{data}.json"])


def test_the_wheel_runs_in_a_clean_environment(packages: tuple[Path, Path], tmp_path: Path) -> None:
    venv.create(tmp_path / "clean", with_pip=False)
    python = tmp_path / "clean" / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    site = Path(run(str(python), "-c", "import sysconfig; print(sysconfig.get_path('purelib'))", where=tmp_path).strip())
    with zipfile.ZipFile(packages[1]) as wheel:
        wheel.extractall(site)
    # libraries are those of this environment, and behind them nothing that is editable
    (site / "libraries.pth").write_text("\n".join(dict.fromkeys((sysconfig.get_path("purelib"), *filter(_is_site, sys.path)))))
    place = run(str(python), "-c", "import fastbeam; print(fastbeam.__file__)", where=tmp_path).strip()
    assert place == str(site / "fastbeam" / "__init__.py")
    assert "crane" in run(str(python), "-m", "fastbeam", where=tmp_path)
    assert run(str(python), "-m", "fastbeam", "doctor", where=tmp_path).count("\nok ") == 2
    run(str(python), "-m", "fastbeam", "run", "crane", "--out", "pictures", where=tmp_path)
    assert (tmp_path / "pictures" / "crane.png").stat().st_size > 10_000


@pytest.mark.parametrize("python", [x for x in os.environ.get("FASTBEAM_PYTHONS", "").split(os.pathsep) if x])
def test_other_pythons_install_and_run_it(packages: tuple[Path, Path], tmp_path: Path, python: str) -> None:
    """With all libraries from the registry, which takes minutes: FASTBEAM_PYTHONS=/path/to/python3.12:/path/to/python3.13"""
    run(python, "-m", "venv", "new", where=tmp_path)
    own = str(tmp_path / "new" / "bin" / "python")
    run(own, "-m", "pip", "install", "-q", "--disable-pip-version-check", str(packages[1]), where=tmp_path)
    assert run(own, "-m", "fastbeam", "doctor", where=tmp_path).count("\nok ") == 2


def _is_site(path: str) -> bool:
    return path.endswith("site-packages")
