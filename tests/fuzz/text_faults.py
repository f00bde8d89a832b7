"""What happens to text files: cut, flipped, doubled, in another encoding."""

from __future__ import annotations

import random


def spoil(rng: random.Random, text: bytes) -> bytes:
    """The text with one thing wrong that no editor would do, or that one would."""
    if not text:
        return text
    at = rng.randrange(len(text))
    lines = text.split(b"\n")
    line = rng.randrange(len(lines))
    choice = rng.randrange(14)
    if choice == 0:
        return text[:at]
    if choice in (1, 2):
        return text[:at] + bytes([rng.randrange(256)]) + text[at + 1 :]
    if choice == 3:
        return (
            text[:at]
            + rng.choice((b"\x00", b"\xff", b"\x1a", b"\xc2\x85", b"\xe2\x80\xa8", b"\xed\xa0\x80"))
            + text[at:]
        )
    if choice == 4:
        return b"\xef\xbb\xbf" * rng.choice((1, 2)) + text
    if choice == 5:
        return text.decode("utf-8", "replace").encode(rng.choice(("utf-16", "utf-16-le", "utf-32", "utf-7")))
    if choice == 6:
        return text.decode("utf-8", "replace").encode("latin-1", "replace")
    if choice == 7:
        return text.replace(b"\n", rng.choice((b"\r\n", b"\r", b"\n\n", b"")))
    if choice == 8:
        return text.replace(b"  ", b"\t", rng.choice((1, -1)))
    if choice == 9:
        return b"\n".join([*lines[:line], *lines[line : line + 1] * rng.choice((2, 50)), *lines[line + 1 :]])
    if choice == 10:
        return b"\n".join([*lines[:line], *lines[line + 1 :]])
    if choice == 11:
        rng.shuffle(lines)
        return b"\n".join(lines)
    if choice == 12:
        return rng.choice((b"", b"\n", b" ", b"#", b"\x00" * 20, b"0", b"[]", b"{}", b"null", text + text))
    return text[: at // 2] + text[at:]
