"""The code blocks of README and documentation: what they tell a reader to run is run, and prints what they show.

Each page has a folder of its own, beside links to ``problems`` and ``.venv``; its blocks are run there in order:

    ```sh, ```python            run
    ```yaml                     solved, as a problem file
    <!-- NAME -->               named block: ``sh NAME`` prints it, nothing else runs it
    <!-- file: NAME -->         written as that file, for the blocks after it
    <!-- into: PROBLEM -->      yaml: sections put into that built-in problem, which is loaded
    <!-- not run: REASON -->    left alone
    <!-- shown: COMMAND -->     what the command prints, with ``[…]`` where something is left out
    <!-- shown | FILTER -->     what the sh or python block before it printed, through a shell filter; ``shown``: whole.
                                ``lead`` is a filter for all before the first heading, ``lead 2`` before the second

    python .ci/readme.py sh NAME          the shell block of that name in README.md
    python .ci/readme.py check [PAGE …]   run everything on all pages, or on these
    python .ci/readme.py write [PAGE …]   the same, and put in what commands print now wherever it differs
"""

from __future__ import annotations

import difflib
import os
import re
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

NUMBER = re.compile(r"\d+(?:\.\d+)?(?:e[+-]?\d+)?")
RESAMPLED = re.compile(rf"± ?({NUMBER.pattern})|\((?:factor )?-?({NUMBER.pattern}) to -?({NUMBER.pattern})")
RESAMPLED_TOLERANCE = 2e-2  # relative: some hundred draws give a standard error or an end of an interval no better
TOLERANCE = 1e-6  # relative, of a number that is shown with all of its digits: as an optimiser determines it
ROOT = Path(__file__).resolve().parents[1]
BLOCK = re.compile(
    r"(?:<!-- (?P<mark>[^\n]+?) -->\n)?^```(?P<language>\w*)\n(?P<code>.*?)^```$", re.DOTALL | re.MULTILINE
)
CUT = "[…]\n"
LEAST_LIKENESS = 0.6  # of a line that has been reworded: below it, a renewed part needs a human
LEAD = r"""lead() { awk '/^-+$/ { if (++n == '"${1:-1}"') exit } NR > 1 { print last } { last = $0 }'; }
"""
INTO = """
import sys, yaml, posture_opt as po
from pathlib import Path
class Loader(yaml.SafeLoader):
    pass  # YAML 1.1 has on and off as truth values; problem files, and YAML 1.2, do not
Loader.yaml_implicit_resolvers = {
    first: [(tag, form) for tag, form in known if not (tag.endswith(":bool") and first in "oO")]
    for first, known in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
builtin, fragment = (yaml.load(Path(p).read_text(encoding="utf-8"), Loader) for p in sys.argv[1:])
po.problem_from_dict(builtin | fragment, "." if "robot" in fragment else Path(sys.argv[1]).parent)
"""


class StaleError(Exception):
    """What a page shows is not what its command prints, and nothing alike was found."""


@dataclass(frozen=True)
class Block:
    """One fenced block: what the comment before it says, its language, and where its code stands in the page."""

    mark: str
    language: str
    code: str
    start: int
    end: int

    @property
    def action(self) -> str:
        """First word of the mark where it is one of ours, ``named`` otherwise, ``run`` or nothing without one."""
        word = re.match(r"shown|file|into|not run|$", self.mark)
        if word is None:
            return "named"
        return word[0] or ("run" if self.language in ("sh", "python", "yaml") else "")

    @property
    def argument(self) -> str:
        return self.mark.partition(":")[2].strip()


@dataclass(frozen=True)
class Page:
    path: Path
    text: str

    @classmethod
    def read(cls, path: Path) -> Page:
        return cls(path, path.read_text(encoding="utf-8"))

    @property
    def blocks(self) -> list[Block]:
        return [
            Block(m["mark"] or "", m["language"], m["code"], m.start("code"), m.end("code"))
            for m in BLOCK.finditer(self.text)
        ]

    def with_code(self, changes: list[tuple[Block, str]]) -> Page:
        text = self.text
        for block, code in sorted(changes, key=lambda change: -change[0].start):
            text = text[: block.start] + code + text[block.end :]
        return replace(self, text=text)


def pages(names: list[str]) -> list[Page]:
    """README and all pages that have blocks, or those of these names."""
    own = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    paths = [Path(name).resolve() for name in names] or [p for p in own if "generated" not in p.parts]
    return [page for page in map(Page.read, paths) if any(block.action for block in page.blocks)]


def run_page(page: Page, write: bool) -> tuple[str, Page, float]:
    """What is wrong with a page, the page as it should be, and how long its blocks took [s]."""
    began, problems, changes, printed = time.perf_counter(), [], [], ""
    with tempfile.TemporaryDirectory() as folder:
        here = Path(folder)
        for link in ("problems", ".venv"):
            if (ROOT / link).exists():
                (here / link).symlink_to(ROOT / link)
        for block in page.blocks:
            try:
                if block.action == "shown":
                    now = shown_now(block, printed, here)
                    if now != block.code and write:
                        changes.append((block, now))
                    elif not alike(now, block.code):
                        lines = block.code.splitlines(), now.splitlines()
                        diff = difflib.unified_diff(*lines, "shown", "printed", lineterm="")
                        problems.append("\n".join([f"[{block.mark}] is stale:", *diff]))
                else:
                    printed = act(block, here)
            except (subprocess.CalledProcessError, StaleError) as error:
                told = f"{error}\n{getattr(error, 'stdout', '') or ''}{getattr(error, 'stderr', '') or ''}"
                problems.append(f"```{block.language} {block.mark}\n{block.code}```\n{told}")
    return "\n\n".join(problems), page.with_code(changes), time.perf_counter() - began


def alike(one: str, other: str) -> bool:
    """Whether texts agree but for spaces, rules of tables, and digits that another processor rounds differently.

    Words and whole numbers are the same, other numbers to one of their last decimal, and those that may be resampled
    (after ``±``, and the ends of an interval in brackets) to 2 %.
    """
    texts = [re.sub(r"-{2,}", "--", " ".join(text.split())) for text in (one, other)]
    if NUMBER.sub("#", texts[0]) != NUMBER.sub("#", texts[1]):
        return False
    resampled = {m.start(i) for m in RESAMPLED.finditer(texts[0]) for i in (1, 2, 3) if m[i]}
    found = [list(NUMBER.finditer(text)) for text in texts]
    return all(close(a[0], b[0], a.start() in resampled) for a, b in zip(*found, strict=True))


def close(a: str, b: str, resampled: bool = False) -> bool:
    """Whether numbers differ by one of the last decimal at most, or by what they are known to; whole: not at all."""
    if a == b:
        return True
    if not resampled and not re.search(r"[.e]", a + b):
        return False
    relative = RESAMPLED_TOLERANCE if resampled else TOLERANCE
    steps = [step(text) for text in (a, b) if re.search(r"[.e]", text)]
    return abs(float(a) - float(b)) <= max(relative * abs(float(a)), 1.01 * max(steps, default=0.0))


def step(text: str) -> float:
    """One of the last decimal of a number."""
    digits, _, exponent = text.partition("e")
    return float(10.0 ** (int(exponent or 0) - len(digits.partition(".")[2])))


def act(block: Block, here: Path) -> str:
    """Do what a block asks for; what it prints."""
    if block.action == "file":
        (here / block.argument).write_text(block.code, encoding="utf-8")
    elif block.action == "into":
        (here / "fragment.yaml").write_text(block.code, encoding="utf-8")
        return output(
            [sys.executable, "-c", INTO, str(ROOT / f"problems/{block.argument}.yaml"), "fragment.yaml"], here
        )
    elif block.action == "run" and block.language == "python":
        return output([sys.executable, "-W", "error", "-c", block.code], here)
    elif block.action == "run" and block.language == "yaml":
        (here / "block.yaml").write_text(block.code, encoding="utf-8")
        return output(["optimize-posture", "--problem", "block.yaml", "--json"], here)
    elif block.action == "run":
        return output(["bash", "-euo", "pipefail", "-c", block.code], here)
    return ""


def output(command: list[str], here: Path, given: str = "") -> str:
    """Standard output of a command, which sees no terminal and so no width."""
    environment = {k: v for k, v in os.environ.items() if k not in ("COLUMNS", "LINES")} | {"PYTHONIOENCODING": "utf-8"}
    done = subprocess.run(
        command, check=True, capture_output=True, text=True, encoding="utf-8", cwd=here, input=given, env=environment
    )
    return done.stdout


def shown_now(block: Block, printed: str, here: Path) -> str:
    """What a block should show: the whole of what is printed, or the parts of it between the cuts."""
    if block.mark.startswith("shown:"):
        printed = output(["bash", "-c", block.argument], here)
    if "|" in block.mark and not block.mark.startswith("shown:"):
        printed = output(["bash", "-c", LEAD + block.mark.partition("|")[2]], here, given=printed)
    whole = "\n".join(line.rstrip() for line in printed.strip("\n").splitlines()) + "\n"
    if CUT not in block.code:
        return whole
    lines, parts = whole.splitlines(keepends=True), []
    for part in block.code.split(CUT):
        found, lines = cut_out(part, lines)
        parts.append(found)
    return CUT.join(parts)


def cut_out(part: str, lines: list[str]) -> tuple[str, list[str]]:
    """The lines that a part is now, between those most like its first and its last one, and the lines after them."""
    wanted = part.strip("\n").splitlines(keepends=True)
    if not wanted:
        return part, lines
    text = "".join(lines)
    if (exact := "".join(wanted).rstrip("\n")) and f"\n{exact}\n" in f"\n{text}\n":
        after = f"\n{text}\n".partition(f"\n{exact}\n")[2]
        return part, after.splitlines(keepends=True)
    first = most_like(wanted[0], lines)
    last = first + most_like(wanted[-1], lines[first:]) if len(wanted) > 1 else first
    lead, tail = (part[: len(part) - len(part.lstrip("\n"))], "\n" * (len(part) - len(part.rstrip("\n")) - 1))
    return lead + "".join(lines[first : last + 1]).rstrip("\n") + "\n" + tail, lines[last + 1 :]


def most_like(line: str, lines: list[str]) -> int:
    """Index of the line most like this one, numbers aside."""

    def words(text: str) -> str:
        return re.sub(r"\d+", "#", text)

    likeness = [difflib.SequenceMatcher(None, words(line), words(other)).ratio() for other in lines] or [0.0]
    if max(likeness) < LEAST_LIKENESS:
        raise StaleError(f"no line is like {line.strip()!r} any more: fix the block by hand")
    return likeness.index(max(likeness))


def main() -> None:
    mode, names = sys.argv[1], sys.argv[2:]
    if mode == "sh":
        (code,) = [block.code for block in Page.read(ROOT / "README.md").blocks if block.mark == names[0]]
        print(code)
        return
    asked, failed = pages(names), False
    with ProcessPoolExecutor(2) as pool:
        answers = pool.map(run_page, asked, [mode == "write"] * len(asked))
        for page, (problems, renewed, seconds) in zip(asked, answers, strict=True):
            changed = renewed.text != page.text
            print(f"-- {page.path.relative_to(ROOT)}: {seconds:.1f} s{', renewed' if changed else ''}", flush=True)
            if changed:
                page.path.write_text(renewed.text, encoding="utf-8")
            if problems:
                failed = True
                print(problems, flush=True)
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
