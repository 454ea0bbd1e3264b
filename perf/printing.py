"""Tables of the commands, for the screen or for a page of the documentation."""
from __future__ import annotations

from collections.abc import Sequence

# what is measured, at most, found, a note
Bar = tuple[str, float, float, str]


def table(header: Sequence[str], lines: Sequence[Sequence[str]], markdown: bool = False, left: Sequence[int] = (0,)) -> str:
    """Text of a table; `left`: columns whose texts begin below each other, those of others end there. Lines shorter than the
    header end with a remark."""
    if markdown:
        rows = [header, ["---"] * len(header), *([*line, *[""] * (len(header) - len(line))] for line in lines)]
        return "\n".join("| " + " | ".join(row) + " |" for row in rows)
    # a remark may be as long as it likes
    width = [max(len(row[k]) for row in [header, *lines] if k < len(row) - (len(row) < len(header))) for k in range(len(header))]
    out = []
    for row in [header, *lines]:
        cells = [text.ljust(w) if k in left else text.rjust(w) for k, (text, w) in enumerate(zip(row, width))]
        if len(row) < len(header):
            cells[-1] = row[-1]
        out.append("  ".join(cells).rstrip())
    return "\n".join(out)


def judged(found: list[Bar]) -> int:
    """Print all bars; how many are missed."""
    lines = [[text, f"{most:g}", f"{value:.4g}", "ok" if value <= most else "missed", note] for text, most, value, note in found]
    print(table(["bar", "at most", "found", "", "note"], lines))
    return sum(not value <= most for _, most, value, _ in found)
