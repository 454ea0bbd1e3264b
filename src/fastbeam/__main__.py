"""Command line: `python -m fastbeam` lists the examples, `run NAME [--out DIR]` runs one, `warmup` compiles kernels, `doctor`
reports on the installation and tests it."""
from __future__ import annotations

import argparse
import ast
import importlib.util
import sys
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import ModuleType


def example_folders() -> list[Path]:
    """Return folders that may hold examples: beside the installed package, or in the source tree this package lies in."""
    package = Path(__file__).resolve().parent
    return [package / "examples", package.parents[1] / "examples"]


def find_examples() -> dict[str, Path]:
    """Find the scripts of all examples, name -> script; files that start with an underscore are no examples."""
    for folder in example_folders():
        scripts = sorted(path for path in folder.glob("*.py") if not path.name.startswith("_"))
        if scripts:
            return {path.stem: path for path in scripts}
    return {}


def first_line(script: Path) -> str:
    """Return the first line of a script's docstring, read without running it."""
    doc = ast.get_docstring(ast.parse(script.read_text(encoding="utf-8"))) or ""
    return doc.split("\n", 1)[0]


def list_examples() -> str:
    """List the examples, one line each: name and what it shows."""
    examples = find_examples()
    if not examples:
        return "no examples found in " + " or ".join(str(folder) for folder in example_folders())
    width = max(len(name) for name in examples)
    return "\n".join(f"  {name:<{width}}  {first_line(path)}" for name, path in examples.items())


def load_example(name: str) -> ModuleType:
    """Import an example's script. Raises KeyError: there is no such example."""
    path = find_examples()[name]
    spec = importlib.util.spec_from_file_location(f"fastbeam_example_{name}", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    # dataclasses and typing look a module up by its name
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def program_version() -> str:
    """Return the version of the installed package."""
    try:
        return version("fastbeam")
    except PackageNotFoundError:
        return "not installed"


def warm_up(kinds: list[str]) -> int:
    """Compile the kernels of kinds of scenes, all where none is named; returns the exit code."""
    from fastbeam import warmup
    unknown = [kind for kind in kinds if kind not in warmup.KINDS]
    if unknown:
        print(f"kind of scene '{unknown[0]}' does not exist; choose from: {', '.join(warmup.KINDS)}", file=sys.stderr)
        return 2
    warmup.warm_up(kinds or list(warmup.KINDS), lambda text: print(text, flush=True))
    return 0


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; returns the exit code (2: wrong use)."""
    parser = argparse.ArgumentParser(prog="python -m fastbeam", description="Geometrically exact beams with sliding contact.")
    parser.add_argument("--version", action="version", version=f"fastbeam {program_version()}")
    commands = parser.add_subparsers(dest="command", metavar="command")
    run = commands.add_parser("run", help="run an example and write its pictures and results")
    run.add_argument("name", help="name of the example")
    run.add_argument("--out", default="out", help="folder for what it writes (default: out)")
    warm = commands.add_parser("warmup", help="compile the kernels of common scenes ahead of their first use")
    warm.add_argument("kinds", nargs="*", metavar="kind", help="of scenes: beam, slider, planar-slider, mechanism, "
                      "planar-mechanism, statics, planar-statics (default: all)")
    commands.add_parser("doctor", help="print what is installed, and run a short self-test")
    chosen = parser.parse_args(arguments)
    if chosen.command == "doctor":
        from fastbeam.doctor import examine
        return examine(lambda text: print(text, flush=True))
    if chosen.command == "warmup":
        return warm_up(chosen.kinds)
    if chosen.command is None:
        print(f"examples (python -m fastbeam run NAME [--out DIR]):\n{list_examples()}")
        return 0
    if chosen.name not in find_examples():
        print(f"example '{chosen.name}' does not exist; choose from:\n{list_examples()}", file=sys.stderr)
        return 2
    if not chosen.out.strip() or "\0" in chosen.out or Path(chosen.out).is_file():
        print(f"--out: '{chosen.out}' is {'a file' if chosen.out.strip() else 'no name'}; give a folder", file=sys.stderr)
        return 2
    load_example(chosen.name).main(out=chosen.out)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
