"""Whoever reads a kernel finds the shape of every array that it takes: in its docstring, in that of the generic function that it
implements, in the list "Arrays: ..." at the head of its file, or at the field of the record that holds the array.

A shape stands behind names: `q, q_mid [12 N]`. What is an array is found in the source: arguments that are indexed or asked for
their shape, and arguments that are handed on to something that takes an array there.
"""
from __future__ import annotations

import ast
import re
from collections import defaultdict
from pathlib import Path
from typing import Any

KERNELS = Path(__file__).resolve().parents[2] / "src" / "fastbeam" / "kernels"
DECORATORS = {"kernel", "one_variant", "inlined", "separate"}
# what follows an array in the arguments of functions that load and store; arrays that are followed by other things
PLACES, ALWAYS = {"first", "node", "p", "f"}, {"source", "target", "index"}
SEPARATOR = r"(?:,\s+|\s+and\s+)"
SHAPES = re.compile(rf"((?:`?\w+`?{SEPARATOR})*`?\w+`?)\s\[[^\]]+\]")
Name = tuple[str, str]  # (module with its packages, function)


def parameters(node: ast.FunctionDef) -> list[str]:
    return [x.arg for x in node.args.args]


def shaped(text: str | None) -> set[str]:
    """Names that a text gives a shape."""
    return {name.strip("`") for found in SHAPES.findall(text or "") for name in re.split(SEPARATOR, found)}


def memory(names: list[str]) -> set[int]:
    """Arrays among the arguments of a function that is written in LLVM code."""
    return {i for i, (name, after) in enumerate(zip(names, [*names[1:], ""]))
            if name in ALWAYS or after.endswith("offset") or after in PLACES}


class Sources:
    """Functions of some modules, and which of their arguments are arrays."""

    def __init__(self, texts: dict[str, str]) -> None:
        self.trees = {name: ast.parse(text) for name, text in texts.items()}
        self.compiled: dict[Name, ast.FunctionDef] = {}
        self.generic: dict[Name, ast.FunctionDef] = {}
        self.generic_of: dict[Name, list[Name]] = defaultdict(list)
        self.imports: dict[str, dict[str, Name]] = {}
        self.arrays: dict[Name, set[int]] = defaultdict(set)
        # arguments of the functions that factories return
        self.made: dict[Name, list[str]] = {}
        for module, tree in self.trees.items():
            self.imports[module] = {a.asname or a.name: (x.module or a.name, a.name) for x in tree.body
                                    if isinstance(x, ast.ImportFrom) and x.module for a in x.names}
            self._take_functions(module, [x for x in tree.body if isinstance(x, ast.FunctionDef)])
        for module, tree in self.trees.items():
            self._take_made(module, tree)
        for name, node in self.compiled.items():
            self.arrays[name] |= {i for i, x in enumerate(parameters(node)) if _is_indexed(node, x)}
        while self._propagate():
            pass

    def _take_functions(self, module: str, functions: list[ast.FunctionDef]) -> None:
        for node in functions:
            name = module, node.name
            decorators = {ast.unparse(x) for x in node.decorator_list}
            if decorators & DECORATORS:
                self.compiled[name] = node
            if "generic" in decorators:
                self.generic[name] = node
            if node.name.lstrip("_").startswith("make_"):
                self.made[name] = next((parameters(x)[1:] for x in node.body if isinstance(x, ast.FunctionDef)), [])
            if "intrinsic" in decorators:
                self.arrays[name] = memory(parameters(node)[1:])
            for x in node.decorator_list:
                if isinstance(x, ast.Call) and isinstance(x.func, ast.Attribute) and x.func.attr == "register":
                    self.generic_of[name] += self._named(module, x.func.value)

    def _take_made(self, module: str, tree: ast.Module) -> None:
        """Names of what factories of functions return, as in `vld, vst = make_load(1), make_store(1)`."""
        for node in tree.body:
            if isinstance(node, ast.Assign):
                targets = node.targets[0].elts if isinstance(node.targets[0], ast.Tuple) else node.targets
                values = node.value.elts if isinstance(node.value, ast.Tuple) else [node.value] * len(targets)
                for target, value in zip(targets, values):
                    for call in ast.walk(value):
                        for maker in self._named(module, call.func) if isinstance(call, ast.Call) else ():
                            if maker in self.made:
                                self.arrays[module, ast.unparse(target)] = memory(self.made[maker])

    def _named(self, module: str, node: ast.expr) -> list[Name]:
        """What an expression like f, f.call or module.f names."""
        if isinstance(node, ast.Name):
            return [self.imports[module].get(node.id, (module, node.id))]
        if isinstance(node, ast.Attribute) and node.attr in ("call", "each", "each_backward", "all"):
            return self._named(module, node.value)
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in self.imports[module]:
            return [(".".join(self.imports[module][node.value.id]), node.attr)]
        return []

    def _propagate(self) -> bool:
        """One round from what is called to what calls it, and between a generic function and its implementations."""
        before = sum(map(len, self.arrays.values()))
        for name, generics in self.generic_of.items():
            for other in generics:
                self.arrays[other] |= self.arrays[name]
                self.arrays[name] |= self.arrays[other]
        for name, node in self.compiled.items():
            places = {x: i for i, x in enumerate(parameters(node))}
            for call in ast.walk(node):
                if isinstance(call, ast.Call):
                    taken = {i for callee in self._named(name[0], call.func) for i in self.arrays.get(callee, ())}
                    self.arrays[name] |= {places[x.id] for i, x in enumerate(call.args)
                                          if i in taken and isinstance(x, ast.Name) and x.id in places}
        return sum(map(len, self.arrays.values())) > before

    def taken(self) -> list[tuple[Name, str]]:
        """(function, argument) of all arrays that compiled and generic functions take."""
        return [(name, parameters(node)[i]) for name, node in {**self.compiled, **self.generic}.items()
                for i in sorted(self.arrays[name]) if i < len(parameters(node))]

    def without_shape(self) -> list[str]:
        out = []
        for (module, function), argument in self.taken():
            name = module, function
            nodes: list[Any] = [{**self.compiled, **self.generic}[name], self.trees[module]]
            nodes += [self.generic[x] for x in self.generic_of[name] if x in self.generic]
            if argument not in set().union(*(shaped(ast.get_docstring(x)) for x in nodes)):
                out.append(f"{module}.py: {function}: {argument}")
        return out


def _is_indexed(node: ast.FunctionDef, name: str) -> bool:
    """`x[i]` or `x.shape[0]`; `x.shape[i, j]` is the table `shape` of a record."""
    for x in ast.walk(node):
        if isinstance(x, ast.Subscript):
            if isinstance(x.value, ast.Name) and x.value.id == name:
                return True
            if isinstance(x.value, ast.Attribute) and x.value.attr == "shape" and not isinstance(x.slice, ast.Tuple):
                if isinstance(x.value.value, ast.Name) and x.value.value.id == name:
                    return True
    return False


def fields_without_shape(path: Path) -> list[str]:
    """Arrays of records, whose comment has to begin like `# float64 [3 N]`."""
    lines = path.read_text(encoding="utf-8").splitlines()
    return [f"{path.name}: {node.name}.{ast.unparse(field.target)}"
            for node in ast.walk(ast.parse("\n".join(lines))) if isinstance(node, ast.ClassDef)
            for field in node.body if isinstance(field, ast.AnnAssign) and "np.ndarray" in ast.unparse(field.annotation)
            and not re.search(r"# (float64|int64|int32|int8) \[[^\]]+\]", lines[field.lineno - 1])]


FILES = {".".join(("fastbeam.kernels", *path.relative_to(KERNELS).with_suffix("").parts)): path
         for path in sorted(KERNELS.rglob("*.py"))}
ALL = Sources({name: path.read_text(encoding="utf-8") for name, path in FILES.items()})


def test_every_array_that_a_kernel_takes_has_a_shape() -> None:
    assert len(ALL.taken()) > 500
    assert ALL.without_shape() == []


def test_every_array_of_a_record_has_a_shape() -> None:
    found = [x for path in FILES.values() for x in fields_without_shape(path)]
    assert found == []


def test_arrays_are_found_through_calls_generic_functions_and_loads() -> None:
    source = '''"""Arrays: q, v [12 N]."""
from fastbeam.kernels.algebra.vectors import vld as load
@generic
def ask(term, x):
    """x [3]"""
@ask.register(Bodies)
@kernel
def answer(bodies, x):
    return x[0]
@kernel
def inner(a, n):
    """a [n]"""
    return load(a, 0, 0)
@kernel
def outer(q, z, i, term):
    return inner(q, i) + inner(z, i) + ask.call(term, z)
'''
    vectors = "fastbeam.kernels.algebra.vectors"
    sources = Sources({vectors: FILES[vectors].read_text(encoding="utf-8"), "some": source})
    assert [x for x in sources.taken() if x[0][0] == "some"] == [
        (("some", "answer"), "x"), (("some", "inner"), "a"), (("some", "outer"), "q"), (("some", "outer"), "z"),
        (("some", "ask"), "x")]
    assert sources.without_shape() == ["some.py: outer: z"]


def test_a_shape_stands_behind_names() -> None:
    assert shaped("Arrays: q, q_mid [12 N]; `r` and\n`x` [8 (rows + 1)]; y (3), a[i]") == {"q", "q_mid", "r", "x"}
