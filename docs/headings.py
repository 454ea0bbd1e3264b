"""For the pages of docs/api: methods are headed by their class, too, as in 'Result.slider'. mkdocs calls what stands here."""
from __future__ import annotations

import re
from typing import Any

HEADING = re.compile(r'(<h3 id="fastbeam\.(?:[\w.]+\.)?(\w+)\.\w+" class="doc doc-heading">\s*<span class="[\w -]*">)(?=\w)')


def on_page_content(html: str, **more: Any) -> str:
    """The page with these headings."""
    return HEADING.sub(r"\1\2.", html)
