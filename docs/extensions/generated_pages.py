"""Pages that are made of the program itself: they are written into ``docs/generated`` before a build."""

from __future__ import annotations

from pathlib import Path

from command_line import command_line_page
from effect_formulas import effects_page
from effect_pictures import EXAMPLES, draw_effect
from limits_table import limits_table
from noise_pictures import PICTURES as OF_NOISE
from noise_pictures import draw_noise
from presets import presets_table
from problem_file import problem_file_page
from python_names import python_names_page
from task_pictures import draw_tasks
from term_formulas import terms_page
from term_pictures import PICTURES as OF_TERMS
from term_pictures import draw_term


def write_pages(docs: Path) -> None:
    """Write every generated page, and leave alone those that are as they were: they need no new build."""
    pages = {
        "python.rst": python_names_page(),
        "parts/command_line.md": command_line_page(),
        "parts/effects.md": effects_page(),
        "parts/limits.md": limits_table(),
        "parts/presets.md": presets_table(),
        "parts/problem_file.md": problem_file_page(),
        "parts/tasks.md": draw_pictures(docs / "generated" / "pictures"),
        "parts/terms.md": terms_page(),
    }
    for name, text in pages.items():
        path = docs / "generated" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def draw_pictures(folder: Path) -> str:
    """Write the pictures of all effects, terms and tasks; the table that compares the tasks comes back."""
    folder.mkdir(parents=True, exist_ok=True)
    for kind in EXAMPLES:
        draw_effect(kind, folder)
    for kind in OF_NOISE:
        draw_noise(kind, folder)
    for kind in OF_TERMS:
        draw_term(kind, folder)
    return draw_tasks(folder)
