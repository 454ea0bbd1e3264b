"""One line of what the stress tests print."""
from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Row:
    """A case, what should happen, what happened, and whether that is right."""

    case: str
    expected: str
    happened: str
    ok: bool

    def __str__(self) -> str:
        return f"  {self.case:<62} {self.expected:<44} {self.happened:<70} {'ok' if self.ok else 'NO'}"

    @staticmethod
    def head() -> str:
        """Names of the columns."""
        return f"  {'case':<62} {'expected':<44} {'happened':<70} ok"
