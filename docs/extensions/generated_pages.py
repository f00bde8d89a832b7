"""Pages that are made of the program itself: they are written into ``docs/generated/parts`` before a build."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from command_line import command_line_page


def write_pages(app: Any) -> None:
    """Write every generated part, and leave alone those that are as they were: their pages need no new build."""
    folder = Path(app.srcdir) / "generated" / "parts"
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in {"command_line.md": command_line_page()}.items():
        path = folder / name
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def setup(app: Any) -> dict[str, bool]:
    app.connect("builder-inited", write_pages)
    return {"parallel_read_safe": True}
