"""For the pages of docs/api: methods are headed by their class, too, as in 'Result.slider'. mkdocs calls what stands here."""
from __future__ import annotations

import re
from typing import Any

MEMBER = r"fastbeam\.(?:[\w.]+\.)?(\w+)\.\w+"
HEADING = re.compile(rf'(<h3 id="{MEMBER}" class="doc doc-heading">\s*<span class="[\w -]*">)(?=\w)')


def on_page_content(html: str, *, page: Any, **more: Any) -> str:
    """The page with these headings; its table of contents, from which the search takes titles, gets them, too."""
    for part in page.toc:
        for block in part.children:
            for member in block.children:
                found = re.fullmatch(MEMBER, member.id)
                if found:
                    member.title = f"{found[1]}.{member.title}"
    return HEADING.sub(r"\1\2.", html)
