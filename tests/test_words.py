"""Words and sentences that were replaced stay away: in the package, its files, and on the pages."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PLACES = {"posture_opt": (".py", ".yaml"), "problems": (".yaml",), "docs": (".md", ".py", ".ipynb"), "": (".md",)}
WORDS = (
    # left are those that no text of this field needs; `told` and `stands` have meanings that it does
    "fate", "crew", "restless", "strewn", "surest", "weightiest", "odds", "mends", "umbrella", "readmission",
)  # fmt: skip
PHRASES = (
    "hangs? together", "the last word", "drawn arm", "weightiest first", "what no root carries", "as it stands",
    "no news the second time", "is known not to be the one of the drawing", "heads of foreign columns",
    "a mistake is answered with", "move nothing, and spread what they are of", "in the sense of the joint",
    "below which no motion gets", "the same problem seen from the part", "is added to what is not known",
    "what the model gets wrong has a name", "where they had not been seen", "noise alone makes", "the rest has none",
    "comes to lie at", "longer tails than normal", r"hit \d+ times? out of", "with the tool as it must be",
    "the axis is left out", "nothing of note", "meets the clearance", "comes back a turn", "by chance 1 in",
    "better than a million", "gives way under", "(is|are) told (how|what|of|by)",
)  # fmt: skip
ALLOWED = {
    ("docs/lecture/lecture.md", "odds"),  # quoted from Kline and McClintock
}
PATTERN = re.compile(rf"\b(?:{'|'.join((*WORDS, *PHRASES))})\b")


def plain(text: str) -> str:
    """The text in lower case, a blank for every line break; without lines that are pictures of notebooks."""
    return " ".join(" ".join(line for line in text.lower().splitlines() if len(line) < 2000).split())


def texts() -> Iterator[tuple[str, str]]:
    """Path from the root and text of everything that users or developers read."""
    for place, endings in PLACES.items():
        folder = ROOT / place
        for path in sorted(folder.rglob("*") if place else folder.glob("*")):
            if path.suffix in endings and path.is_file() and "site" not in path.relative_to(ROOT).parts:
                yield path.relative_to(ROOT).as_posix(), path.read_text(encoding="utf-8")


def test_replaced_words_and_sentences_stay_away() -> None:
    found = []
    for path, text in texts():
        for match in PATTERN.finditer(plain(text)):
            if (path, match[0]) not in ALLOWED:
                found.append(f"{path}: {match[0]}")
    assert not found, "\n".join(["see the words of this test:", *found])
