"""Kernels can be read: few arguments, short functions, no tests on what is absent."""
from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path
from statistics import median

KERNELS = Path(__file__).resolve().parents[2] / "src" / "fastbeam" / "kernels"
DECORATORS = {"kernel", "one_variant", "inlined", "separate"}
MOST_ARGUMENTS, MEDIAN_ARGUMENTS, LONGEST = 12, 8, 60


def kernels() -> Iterator[tuple[str, str, ast.FunctionDef]]:
    """(file, name, source) of all functions that are compiled from Python; intrinsics write LLVM code and are none."""
    for path in sorted(KERNELS.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef) and DECORATORS & {ast.unparse(x) for x in node.decorator_list}:
                yield path.relative_to(KERNELS).as_posix(), node.name, node


def test_kernels_take_few_arguments() -> None:
    counts = {(file, name): len(node.args.args) for file, name, node in kernels()}
    assert len(counts) > 300
    assert median(counts.values()) <= MEDIAN_ARGUMENTS
    assert not {k: n for k, n in counts.items() if n > MOST_ARGUMENTS}


def test_kernels_are_short() -> None:
    lines = {(file, name): node.end_lineno - node.lineno + 1 for file, name, node in kernels() if node.end_lineno is not None}
    assert not {k: n for k, n in lines.items() if n > LONGEST}


def test_what_is_absent_has_a_type_of_its_own() -> None:
    found = [(file, name, node.lineno) for file, name, kernel in kernels() for node in ast.walk(kernel)
             if isinstance(node, ast.Compare) and any(isinstance(x, (ast.Is, ast.IsNot)) for x in node.ops)]
    assert not found
