"""Runs the programs of the pages: tutorials, the pictures of the gallery, and the film of the first page.

    python docs/pages.py                  # run every tutorial and every example of the gallery; write their pictures into docs/
    python docs/pages.py rope net         # some of them
    python docs/pages.py film             # the film of README.md and docs/index.md alone
    python docs/pages.py --write rope     # and put what a tutorial printed into its page

The blocks ```python of a page are one program, run from top to bottom in an empty folder. A block ```text after them is what they
print there, and a picture of the page is a file that they write. tests/project/test_pages.py runs the same and compares.
"""
from __future__ import annotations

import argparse
import contextlib
import io
import os
import re
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).resolve().parent
BLOCK = re.compile(r"^```(python|text)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
PICTURE = re.compile(r"!\[[^\]]*\]\(([\w./-]+\.png)\)")
NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?", re.IGNORECASE)
# bytes of a picture, and its width in pixels
LARGEST, WIDTH = 60_000, 820
# the film of the first page, and its width in pixels
FILM, FILM_WIDTH = HERE / "ring_on_cable.gif", 560
# numbers below this are round-off, of which only the size counts; those printed with few digits may differ in the last
ROUND_OFF, DIGITS = 1e-9, 2e-3


@dataclass
class Block:
    """A fenced block of a page: 'python' or 'text', and what stands in it."""

    kind: str
    text: str
    line: int


def tutorials() -> list[Path]:
    """Pages with programs that print."""
    return [page for page in sorted(HERE.rglob("*.md")) if {"python", "text"} <= {block.kind for block in blocks(page)}]


def blocks(page: Path) -> list[Block]:
    """All fenced blocks of a page that are programs or what these print."""
    text = page.read_text(encoding="utf-8")
    return [Block(found[1], found[2], text.count("\n", 0, found.start()) + 1) for found in BLOCK.finditer(text)]


def pictures(page: Path) -> list[str]:
    """Names of the pictures that a page shows."""
    return PICTURE.findall(page.read_text(encoding="utf-8"))


@contextlib.contextmanager
def inside(folder: Path) -> Iterator[None]:
    """Work in a folder."""
    before = Path.cwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)


def run(page: Path, folder: Path) -> list[tuple[Block, str]]:
    """Run the program of a page in a folder: every block 'text' with what was printed there since the one before."""
    names: dict[str, Any] = {"__name__": "__page__"}
    out: list[tuple[Block, str]] = []
    printed, program = io.StringIO(), blocks(page)
    with inside(folder), contextlib.redirect_stdout(printed):
        for block in program:
            if block.kind == "python":
                code = compile("\n" * block.line + block.text, str(page), "exec")
                exec(code, names)
            else:
                out.append((block, printed.getvalue()))
                printed.seek(0)
                printed.truncate()
    return out


def same(expected: str, got: str) -> str:
    """'' where both texts agree up to round-off and the last digits of numbers, else how they differ."""
    a, b = expected.strip().splitlines(), got.strip().splitlines()
    if len(a) != len(b):
        return f"{len(b)} lines instead of {len(a)}:\n{got}"
    for x, y in zip(a, b):
        if NUMBER.sub("", x).split() != NUMBER.sub("", y).split():
            return f"expected: {x}\nprinted:  {y}"
        for p, q in zip(NUMBER.findall(x), NUMBER.findall(y), strict=True):
            one, two = float(p), float(q)
            small = abs(one) < ROUND_OFF and abs(two) < 100.0 * ROUND_OFF
            if p == q:
                continue
            if {".", "e"}.isdisjoint(p.lower()):          # whole numbers are counts
                return f"expected: {x}\nprinted:  {y}"
            # a number with few digits may be rounded the other way
            last = 10.0 ** -len(p.lower().partition("e")[0].partition(".")[2]) * (10.0 ** int(p.lower().partition("e")[2] or 0))
            if not small and abs(one - two) > max(DIGITS * abs(one), 2.01 * last):
                return f"expected: {x}\nprinted:  {y}"
    return ""


def palette() -> Any:
    """Colours of pictures: those of lines and of time, each on its way to white, and greys."""
    import matplotlib as mpl
    from matplotlib.colors import to_rgb
    from PIL import Image

    from fastbeam.results.plots.drawing import COLOURS
    lines = [np.array(to_rgb(colour)) for colour in (*COLOURS, "black")]
    time = [np.array(mpl.colormaps["viridis"](x)[:3]) for x in np.linspace(0.0, 0.92, 40)]
    shades = [x + share * (1.0 - x) for x in lines for share in np.linspace(0.0, 1.0, 14)]
    shades += [np.full(3, x) for x in (0.85, 0.9, 0.95, 0.97)]
    shades += [x + share * (1.0 - x) for x in time for share in (0.0, 0.3, 0.6)]
    out = Image.new("P", (1, 1))
    out.putpalette(np.round(255.0 * np.array(shades[:256])).astype(np.uint8).tobytes())
    return out


def shrink(path: Path) -> None:
    """Make a picture small: at most `WIDTH` pixels wide, in the colours of `palette`."""
    from PIL import Image
    with Image.open(path) as image:
        picture = image.convert("RGB")
    if picture.width > WIDTH:
        picture = picture.resize((WIDTH, round(picture.height * WIDTH / picture.width)), Image.Resampling.LANCZOS)
    picture.quantize(palette=palette(), dither=Image.Dither.NONE).save(path, optimize=True)


def write(page: Path, found: list[tuple[Block, str]]) -> None:
    """Put what was printed into the page."""
    text = page.read_text(encoding="utf-8")
    for block, got in found:
        text = text.replace(f"```text\n{block.text}```", f"```text\n{got.strip()}\n```", 1)
    page.write_text(text, encoding="utf-8")


def gallery() -> list[str]:
    """Examples whose pictures, of the same name, the gallery shows."""
    return [Path(name).stem for name in pictures(HERE / "gallery.md") if name.startswith("gallery/")]


def draw_gallery(names: list[str]) -> None:
    """Run the examples of the gallery and keep their pictures."""
    from fastbeam.__main__ import load_example
    (HERE / "gallery").mkdir(exist_ok=True)
    for example in gallery():
        if names and example not in names:
            continue
        with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
            load_example(example).main(out=folder)
            keep(Path(folder) / f"{example}.png", HERE / "gallery" / f"{example}.png")
        print(f"gallery: {example}")


def draw_film() -> None:
    """Write the film of the first page: the example ring_on_cable, about seven times slower than it is."""
    from PIL import Image, ImageSequence

    import fastbeam as fb
    from fastbeam.__main__ import load_example
    result = fb.simulate(fb.compile_scene(load_example("ring_on_cable").build()), t_end=0.6, step=5e-4,
                         output=fb.Output(snapshots=80))
    with tempfile.TemporaryDirectory() as folder:
        fb.animate(result, Path(folder) / "large.gif", fps=20.0, progress=False)
        with Image.open(Path(folder) / "large.gif") as film:
            size = FILM_WIDTH, round(film.height * FILM_WIDTH / film.width)
            small = [frame.convert("RGB").resize(size, Image.Resampling.LANCZOS) for frame in ImageSequence.Iterator(film)]
    first, *later = [frame.quantize(palette=palette(), dither=Image.Dither.NONE) for frame in small]
    # the last frame stays for a second
    first.save(FILM, save_all=True, append_images=later, duration=[50] * len(later) + [1000], loop=0, optimize=True)
    print(f"film: {FILM.name}")


def keep(made: Path, place: Path) -> None:
    """Shrink a picture and put it into docs."""
    shrink(made)
    place.write_bytes(made.read_bytes())


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", help="tutorials, examples, film (default: all)")
    parser.add_argument("--write", action="store_true", help="put what tutorials print into their pages")
    chosen = parser.parse_args()
    different = 0
    for page in tutorials():
        if chosen.names and page.stem not in chosen.names:
            continue
        with tempfile.TemporaryDirectory() as folder:
            found = run(page, Path(folder))
            for name in pictures(page):
                keep(Path(folder) / name, page.parent / name)
        wrong = [said for block, got in found if (said := same(block.text, got))]
        if chosen.write:
            write(page, found)
        else:
            different += len(wrong)
        print("\n".join([f"page: {page.stem}", *([] if chosen.write else wrong)]))
    draw_gallery(chosen.names)
    if not chosen.names or "film" in chosen.names:
        draw_film()
    return 1 if different else 0


if __name__ == "__main__":
    raise SystemExit(main())
