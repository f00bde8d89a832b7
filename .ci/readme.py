"""The code blocks of the README: print a named one, or run all that are not named.

A block is named by a comment before it: ``<!-- main -->``, ``<!-- tests -->``; ``<!-- shown: COMMAND -->`` marks what
a command prints, with ``[…]`` where something is left out.

    python .ci/readme.py sh NAME    the shell block of that name
    python .ci/readme.py run        runs every other sh and python block, and solves every yaml block
    python .ci/readme.py shown      holds what is shown against what the commands print
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from pathlib import Path

BLOCK = re.compile(r"(?:<!-- (?P<name>[^\n]+) -->\n)?```(?P<language>\w*)\n(?P<code>.*?)```", re.DOTALL)
README = Path(__file__).parents[1] / "README.md"


def blocks() -> list[tuple[str, str, str]]:
    """Name, language and code of every block."""
    text = README.read_text(encoding="utf-8")
    return [(m["name"] or "", m["language"], m["code"]) for m in BLOCK.finditer(text)]


def run(language: str, code: str, folder: Path) -> None:
    """Run one block as a reader would, from the top of the repository."""
    if language == "python":
        subprocess.run([sys.executable, "-W", "error", "-c", code], check=True)
    elif language == "yaml":
        file = folder / "block.yaml"
        file.write_text(code, encoding="utf-8")
        subprocess.run(["optimize-posture", "--problem", str(file), "--json"], check=True, stdout=subprocess.DEVNULL)
    else:
        subprocess.run(["bash", "-euo", "pipefail", "-c", code], check=True)


def check_shown() -> None:
    """Every part of what is shown stands in what the command prints, in that order."""
    stale = []
    for name, _, code in blocks():
        if not name.startswith("shown: "):
            continue
        command = name.removeprefix("shown: ")
        rest = subprocess.run(["bash", "-c", command], check=True, capture_output=True, text=True).stdout
        for part in filter(str.strip, code.split("[…]\n")):
            _, found, after = rest.partition(part.strip("\n"))
            stale += [] if found else [f"{command}\ndoes not print:\n{part}"]
            rest = after if found else rest
    print(*stale, sep="\n")
    sys.exit(1 if stale else 0)


def main() -> None:
    if sys.argv[1] == "shown":
        check_shown()
    if sys.argv[1] == "sh":
        (code,) = [code for name, language, code in blocks() if language == "sh" and name == sys.argv[2]]
        print(code)
        return
    with tempfile.TemporaryDirectory() as folder:
        for name, language, code in blocks():
            if not name and language in ("sh", "python", "yaml"):
                print(f"-- {language}\n{code}", flush=True)
                run(language, code, Path(folder))


if __name__ == "__main__":
    main()
