"""Output in notebooks: objects as tables, progress as a line that moves. Texts of names are escaped: files may bring any."""
from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

# rows of a table at most
MOST_ROWS = 50


def table(title: str, header: Sequence[str], rows: Sequence[Sequence[Any]], notes: Iterable[str] = ()) -> str:
    """Return a title, a table and lines below it as HTML; the first 50 rows."""
    cells = "".join(f"<th style='text-align:left'>{escape(str(x))}</th>" for x in header)
    lines = [f"<tr>{cells}</tr>"] if header else []
    for row in rows[:MOST_ROWS]:
        lines.append("<tr>" + "".join(f"<td style='text-align:left'>{escape(str(x))}</td>" for x in row) + "</tr>")
    more = [f"and {len(rows) - MOST_ROWS} more"] if len(rows) > MOST_ROWS else []
    below = "".join(f"<div>{escape(note)}</div>" for note in [*more, *notes])
    return f"<div><b>{escape(title)}</b><table>{''.join(lines)}</table>{below}</div>"


def text(title: str, lines: str) -> str:
    """Return a title and lines of text that keep their columns as HTML."""
    return f"<div><b>{escape(title)}</b><pre style='line-height:1.2'>{escape(lines)}</pre></div>"


class Parts:
    """Base of a scene, which notebooks show as a table of its parts."""

    name: str
    parts: list[Any]
    gravity: Any

    def _repr_html_(self) -> str:
        rows = [(part.kind, getattr(part, "name", None) or "", part) for part in self.parts]
        return table(f"Scene {self.name}", ("part", "name", "what it is"), rows, [f"gravity {self.gravity} m/s^2"])


def is_notebook() -> bool:
    """Return whether this process is the kernel of a notebook."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython is not None and hasattr(ipython, "get_ipython") else None
    return type(shell).__name__ == "ZMQInteractiveShell"


class Line:
    """Bar of progress in the output of a notebook's cell."""

    def __init__(self) -> None:
        from IPython.display import display
        self._handle = display(self._html(0.0, ""), display_id=True)

    def show(self, share: float, words: str) -> None:
        """Show a share from 0 to 1, and words beside it."""
        self._handle.update(self._html(share, words))

    def clear(self) -> None:
        """Remove the bar."""
        from IPython.display import HTML
        self._handle.update(HTML(""))

    @staticmethod
    def _html(share: float, words: str) -> Any:
        from IPython.display import HTML
        return HTML(f"<progress value='{min(max(share, 0.0), 1.0):.4f}' max='1'></progress> {escape(words)}")
