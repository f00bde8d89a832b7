"""Write or check the frozen documents: ``python -m tests.golden check [--slow] [--whole] [--only PREFIX …]``.

``write`` renews those that are named; only what a commit explains may be renewed. ``check`` compares every number at
the precision that it has on any processor; with ``--rtol 1e-9``, all of them as on the machine that wrote them:
``OPENBLAS_CORETYPE=SkylakeX OPENBLAS_NUM_THREADS=1``.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
import warnings
from pathlib import Path

from tests.golden.cases import WHOLE, document, missing, quick, slow, text
from tests.golden.compare import differences

FOLDER = Path(__file__).parent / "documents"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["write", "check"])
    parser.add_argument(
        "--slow",
        action="store_true",
        help="the slow and the real cases instead of those that every run of the tests checks",
    )
    parser.add_argument("--whole", action="store_true", help="only documents that are held whole, one of each kind")
    parser.add_argument("--only", nargs="+", default=[""], help="beginnings of names")
    parser.add_argument("--rtol", type=float, help="for every number, instead of the precision that it has")
    parser.add_argument("--folder", type=Path, default=FOLDER)
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    wrong = 0
    for name, case in slow() if options.slow else quick():
        if not name.startswith(tuple(options.only)) or (options.whole and name not in WHOLE):
            continue
        if reason := missing(name):
            print(f"{name}: skipped, {reason}", flush=True)
            continue
        start = time.perf_counter()
        try:
            found = document(name, case)
        except Exception as error:  # the next case is worth a look too
            found = {"error": f"{type(error).__name__}: {error}"}
        seconds = time.perf_counter() - start
        file = options.folder / f"{name}.json"
        if options.what == "write":
            options.folder.mkdir(parents=True, exist_ok=True)
            file.write_text(text(found) + "\n", encoding="utf-8")
            print(f"{name}: written, {seconds:.1f} s", flush=True)
            continue
        if not file.exists():
            print(f"{name}: no document", flush=True)
            continue
        lines = list(differences(json.loads(file.read_text(encoding="utf-8")), found, options.rtol))
        wrong += bool(lines)
        print(f"{name}: {'as before' if not lines else f'{len(lines)} differences'}, {seconds:.1f} s", flush=True)
        print(*(f"    {line}" for line in lines[:12]), sep="\n", end="\n" if lines else "", flush=True)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
