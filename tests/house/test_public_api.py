"""The public interface is the one of public_api.txt, and every public name stands in the reference.

    make api        after a change of a public name or argument: writes public_api.txt anew

Public is what pages of docs/api show: names of the package, and the members that they name. What is taken away or renamed there
needs an entry in `fastbeam.interface.deprecation` (CONTRIBUTING.md).
"""
from __future__ import annotations

import inspect
import re
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
KEPT = ROOT / "tests" / "public_api.txt"
BLOCK = re.compile(r"^::: fastbeam\.([\w.]+)\n((?: .*\n)*)", re.MULTILINE)


def blocks() -> dict[str, tuple[str, list[str]]]:
    """Name -> page and members of every block of the pages of docs/api."""
    out: dict[str, tuple[str, list[str]]] = {}
    for page in sorted((ROOT / "docs" / "api").glob("*.md")):
        for name, options in BLOCK.findall(page.read_text(encoding="utf-8") + "\n"):
            assert name not in out, f"{name} has two blocks"
            members = re.search(r"members: \[(.*)\]", options)
            out[name] = page.stem, members[1].split(", ") if members else []
    return out


def found(name: str) -> Any:
    """Return what a block shows."""
    import fastbeam as fb
    return getattr(fb, name)


def shown(name: str, thing: Any) -> str:
    """A name with its arguments and their defaults, without types."""
    if not callable(thing) or isinstance(thing, type) and issubclass(thing, BaseException):
        return name
    signature = inspect.signature(thing)
    bare = [p.replace(annotation=inspect.Parameter.empty) for p in signature.parameters.values() if p.name not in ("self", "cls")]
    return name + str(signature.replace(parameters=bare, return_annotation=inspect.Signature.empty))


def public_api() -> list[str]:
    """All public names, sorted."""
    lines = []
    for name, (_, members) in blocks().items():
        thing = found(name)
        lines.append(shown(name, thing))
        lines += [shown(f"{name}.{member}", getattr(thing, member)) for member in members]
    return sorted(lines)


def test_the_public_interface_is_the_one_that_is_kept() -> None:
    now, kept = public_api(), KEPT.read_text(encoding="utf-8").splitlines()
    changes = [f"- {line}" for line in kept if line not in now] + [f"+ {line}" for line in now if line not in kept]
    assert changes == [], "where that is meant: make api, and deprecation.py for what is renamed (CONTRIBUTING.md)"
    assert now == kept and len(now) > 150


def test_a_changed_default_and_a_lost_argument_are_seen() -> None:
    def before(a: int, *, b: float = 1.0) -> None: ...
    def other_default(a: int, *, b: float = 2.0) -> None: ...
    def without(a: int) -> None: ...
    assert shown("f", before) == "f(a, *, b=1.0)"
    assert len({shown("f", x) for x in (before, other_default, without)}) == 3
    assert not any("0x" in line for line in public_api())


def test_every_public_name_has_its_block_and_its_line_in_the_index() -> None:
    import fastbeam as fb
    index = (ROOT / "docs" / "reference.md").read_text(encoding="utf-8")
    names = set(fb.__all__) - {"__version__"}
    pages = blocks()
    assert set(pages) == names
    lines = re.findall(r"^- \[`(\w+)`\]\(api/(\w+)\.md#fastbeam\.(\w+)\): \S.*$", index, re.MULTILINE)
    assert sorted(name for name, _, _ in lines) == sorted(names)
    assert [line for line in lines if line != (line[0], pages[line[0]][0], line[0])] == []
    assert "`fastbeam.__version__`" in index


def test_every_member_of_a_block_is_documented() -> None:
    bare = [f"{name}.{member}" for name, (_, members) in blocks().items() for member in members
            if not inspect.getdoc(inspect.getattr_static(found(name), member))]
    assert bare == []


if __name__ == "__main__":
    sys.path.insert(0, str(ROOT / "src"))
    KEPT.write_text("\n".join(public_api()) + "\n", encoding="utf-8")
