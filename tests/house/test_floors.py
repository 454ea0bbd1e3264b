"""Floors of the house: imports go down only, and few files name the compiler."""
from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "src" / "fastbeam"


def imported(path: Path) -> set[str]:
    """Top-level names of everything a file imports, anywhere in it."""
    out: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            out |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            out.add(node.module.split(".")[0])
    return out


def test_imports_go_down_only() -> None:
    pytest.importorskip("importlinter")
    # the contracts stand in pyproject.toml
    code = ("import sys; sys.path.insert(0, 'src'); from importlinter.cli import lint_imports; "
            "raise SystemExit(lint_imports(config_filename='pyproject.toml', no_cache=True))")
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "4 kept, 0 broken" in done.stdout


def test_only_the_ground_names_the_compiler() -> None:
    # groups of 8 lanes and small blocks are LLVM values, and kernels/linalg/pardiso.py declares a function of MKL
    users = {path.relative_to(PACKAGE).as_posix() for path in PACKAGE.rglob("*.py") if imported(path) & {"numba", "llvmlite"}}
    assert users == {f"kernels/{name}.py" for name in (
        "algebra/blocks", "algebra/dimensions", "algebra/lanes", "algebra/vectors", "jit/cache", "jit/calls", "jit/decorators",
        "jit/generic", "jit/parts", "jit/records", "jit/sealed", "jit/separate", "linalg/constraint_blocks",
        "linalg/pardiso")} | {"model/forces/compiled_laws.py"}


def test_options_of_the_compiler_stand_in_one_file() -> None:
    words = ("njit", "fastmath", "nogil", "error_model")
    users = {path.relative_to(PACKAGE).as_posix() for path in PACKAGE.rglob("*.py")
             if any(word in path.read_text(encoding="utf-8") for word in words)}
    assert users == {"kernels/jit/decorators.py"}


def module_level_imports(path: Path) -> set[str]:
    """Like `imported`, of the statements that run when the file is imported."""
    out: set[str] = set()
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Import):
            out |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            out.add(node.module.split(".")[0])
    return out


def test_heavy_libraries_load_where_they_are_needed() -> None:
    heavy = {"scipy", "h5py", "matplotlib", "tqdm", "pypardiso"}
    early = {path.name: found for path in PACKAGE.rglob("*.py") if (found := module_level_imports(path) & heavy)}
    assert early == {}


def test_no_module_has_the_name_of_a_public_function() -> None:
    # once imported, such a module would stand where the function was
    import fastbeam
    modules = {path.stem for path in PACKAGE.rglob("*.py")} | {path.name for path in PACKAGE.rglob("*") if path.is_dir()}
    assert modules & set(fastbeam.__all__) == set()


def test_every_package_names_what_is_public() -> None:
    from importlib import import_module
    packages = sorted(path.name for path in PACKAGE.iterdir() if (path / "__init__.py").exists())
    assert packages == ["compile", "dynamics", "gradients", "interface", "kernels", "linalg", "model", "results", "scene",
                        "statics", "stepping", "vibration"]
    for name in packages:
        package = import_module(f"fastbeam.{name}")
        assert isinstance(package.__all__, list) and package.__doc__
        assert all(getattr(package, x) is not None for x in package.__all__)
    assert len([path for path in PACKAGE.iterdir() if path.is_file()]) <= 8
