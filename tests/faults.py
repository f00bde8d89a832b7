"""All tests that the page of faults names, in one run: ``python -m tests.faults``.

None may be left out: a test that is skipped shows nothing, and the run fails.
"""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from xml.etree import ElementTree

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "reference" / "faults.md"
_TEST = re.compile(r"`(tests/[\w/]+\.py)::(\w+)`")


def rows_of_the_page() -> Iterator[tuple[str, list[tuple[str, str]]]]:
    """What happens, and the (file, name) of each test that shows what is promised."""
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        if line.startswith("| ") and not line.startswith("| what happens") and "---" not in line:
            yield re.split(r"(?<!\\)\|", line)[1].strip(), _TEST.findall(line)


def main(words: list[str]) -> int:
    """Runs them, with further words for pytest, and says row by row how they ended."""
    rows = list(rows_of_the_page())
    names = list(dict.fromkeys(f"{file}::{name}" for _, tests in rows for file, name in tests))
    with TemporaryDirectory() as folder:
        found = Path(folder) / "found.xml"
        pytest = [sys.executable, "-m", "pytest", "-m", "", "-q", f"--junitxml={found}", *words, *names]
        code = subprocess.run(pytest, cwd=ROOT, check=False).returncode
        ends = _ends(found) if found.exists() else {}
    for what, tests in rows:
        said = [ends.get((file, name), ["did not run"]) for file, name in tests]
        bad = [end for one in said for end in one if end != "passed"]
        print(f"{'ok  ' if not bad else 'BAD '} {what}" + "".join(f"\n     {end}" for end in bad))
        code = code or bool(bad)
    return code


def _ends(found: Path) -> dict[tuple[str, str], list[str]]:
    """(file, name) -> how each of its variants ended."""
    ends: dict[tuple[str, str], list[str]] = {}
    for case in ElementTree.parse(found).iter("testcase"):
        key = f"{case.get('classname', '').replace('.', '/')}.py", str(case.get("name")).split("[")[0]
        bad = [f"{part.tag}: {part.get('message')}" for part in case if part.tag in ("failure", "error", "skipped")]
        ends.setdefault(key, []).append(bad[0] if bad else "passed")
    return ends


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
