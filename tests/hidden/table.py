"""The table of a hunt: shares with their intervals, by family, by strength, and what was taken for what."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from itertools import pairwise
from typing import Any

import numpy as np

from tests.hidden.families import UNEXPLAINED
from tests.hidden.noise import NOISES
from tests.hidden.strength import DETECTABLE

Record = dict[str, Any]
QUIET = ("clean", "exact", "unknowable", "one_robot", "batch_clean")
BINS = (0, 10, 15, 25, 35, 60, 150, np.inf)


def interval(hits: int, n: int, z: float = 1.96) -> tuple[float, float]:
    """Wilson's interval of a share (1927)."""
    if not n:
        return 0.0, 1.0
    p, d = hits / n, 1 + z * z / n
    middle, half = (p + z * z / (2 * n)) / d, z / d * np.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    return float(max(middle - half, 0.0)), float(min(middle + half, 1.0))


def share(flags: Iterable[object]) -> str:
    values = [bool(f) for f in flags]
    if not values:
        return "–"
    low, high = interval(sum(values), len(values))
    return f"{100 * np.mean(values):5.1f} % [{100 * low:3.0f}, {100 * high:3.0f}]"


def detectable(r: Record) -> bool:
    return bool(r["strength"]) and min(r["strength"]) >= DETECTABLE - 1e-6


def report(records: list[Record]) -> str:
    answered = [r for r in records if r["verdict"] != "error"]
    parts = [_families(answered), _quiet(answered), _outside(answered), _strengths(answered), _kinds(answered)]
    parts += [_second(answered), _confusions(answered), _errors(records), _seconds(records)]
    return "\n\n".join(p for p in parts if p)


def _rows(head: list[str], rows: list[list[str]]) -> str:
    widths = [max(len(row[i]) for row in [head, *rows]) for i in range(len(head))]
    return "\n".join("  ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)).rstrip() for row in [head, *rows])


def _families(records: list[Record]) -> str:
    head = ["family", "n", "first name", "of the separable", "verdict right", "right or inside", "all named"]
    head += ["sizes in 95 %", "RMS/true"]
    rows = []
    for family in dict.fromkeys(r["family"] for r in records):
        part = [r for r in records if r["family"] == family and detectable(r)]
        if not part or family in (*QUIET, *UNEXPLAINED):
            continue
        sizes, held = sum(r["sizes"] for r in part), sum(r["sizes_held"] for r in part)
        low, high = interval(held, sizes)
        sizes_text = f"{100 * held / sizes:5.1f} % of {sizes} [{100 * low:.0f}, {100 * high:.0f}]" if sizes else "–"
        ratios = [r["rms_ratio"] for r in part if "rms_ratio" in r]
        ratio = f"{np.median(ratios):.3f} (90 %: {np.quantile(ratios, 0.9):.3f})" if ratios else "–"
        flags = [share(r[key] for r in part) for key in ("first", "exact", "inside", "all_named")]
        flags.insert(1, share(r["first"] for r in part if r["separable"]))
        rows.append([family, str(len(part)), *flags, sizes_text, ratio])
    note = "Detectable effects (λ ≥ 25); separable: no rival explains all but 6 of χ² (with the BIC's price)\n"
    return note + _rows(head, rows) if rows else ""


def _quiet(records: list[Record]) -> str:
    rows = []
    for family in (*QUIET, "heavy_tails"):
        part = [r for r in records if r["family"] == family and not r["truth"]]
        if part:
            alarm = share(r["named"] or r["verdict"] == "unexplained" for r in part)
            kinds = Counter(k for r in part for k, _ in r["named"]).most_common(4)
            told = ", ".join(f"{k} {n}" for k, n in kinds)
            rows.append([family, str(len(part)), alarm, share(r["verdict"] == "unexplained" for r in part), told])
    head = ["nothing to find", "n", "false alarms", "of them unexplained", "named"]
    return _rows(head, rows) if rows else ""


def _outside(records: list[Record]) -> str:
    part = [r for r in records if r["family"] in UNEXPLAINED and detectable(r)]
    rows = []
    for kind in ("", *sorted({r["truth"][0][0] for r in part})):
        chosen = [r for r in part if kind in ("", r["truth"][0][0])]
        wrong = share(r["named"] and r["verdict"] != "unexplained" for r in chosen)
        missed = share(not r["named"] and r["verdict"] != "unexplained" for r in chosen)
        rows.append(
            [kind or "all", str(len(chosen)), share(r["verdict"] == "unexplained" for r in chosen), wrong, missed]
        )
    head = ["outside the catalogue", "n", "unexplained", "wrongly named", "nothing said"]
    return _rows(head, rows) if part else ""


def _second(records: list[Record]) -> str:
    """Whether what was gained holds on the second session, where nothing was fitted."""
    seen = [r for r in records if "second" in r]
    parts = {
        "hidden and rightly named": [r for r in seen if r["second"]["lasting"]],
        "of one session only, left out there": [r for r in seen if r["first"] and _timed(r)],
        "hidden, not or wrongly named": [r for r in seen if r["truth"] and not r["first"]],
        "nothing hidden": [r for r in seen if not r["truth"]],
    }
    rows = []
    for name, part in parts.items():
        if part:
            rms = [r["second"]["rms"] for r in part]
            ratios = [m["extended"] / m["calibrated"] for m in rms]
            flags = [share(x < 1 for x in ratios), share(r["second"]["claimed"] for r in part)]
            flags.append(share(g > 0 for r in part for g in r["second"]["lasting"]))
            rows.append([name, str(len(part)), *flags, f"{np.median(ratios):.3f}"])
    head = ["second session", "n", "RMS below calibrated", "a gain claimed", "each effect gains", "extended/calibrated"]
    return _rows(head, rows) if rows else ""


def _timed(r: Record) -> bool:
    return not r["second"]["lasting"] and any(kind in ("drift", "slip") for kind, _ in r["truth"])


def _single(records: list[Record]) -> list[Record]:
    special = (*QUIET, *NOISES, *UNEXPLAINED, "two", "batch", "geometry")
    return [r for r in records if len(r["truth"]) == 1 and r["family"] not in special]


def _strengths(records: list[Record]) -> str:
    rows = []
    for low, high in pairwise(BINS):
        part = [r for r in _single(records) if low <= r["strength"][0] + 1e-6 < high]
        if part:
            rows.append(
                [
                    f"{low:g} – {high:g}",
                    str(len(part)),
                    share(r["first"] for r in part),
                    share(r["exact"] for r in part),
                ]
            )
    return _rows(["λ", "n", "first name", "verdict right"], rows) if rows else ""


def _kinds(records: list[Record]) -> str:
    part = [r for r in _single(records) if detectable(r)]
    rows = []
    for kind in sorted({r["truth"][0][0] for r in part}):
        of = [r for r in part if r["truth"][0][0] == kind]
        flags = [share(r[key] for r in of) for key in ("first", "exact", "inside")]
        rows.append([kind, str(len(of)), *flags])
    return _rows(["kind", "n", "first name", "verdict right", "right or inside"], rows) if rows else ""


def _confusions(records: list[Record], most: int = 15) -> str:
    """Truth → first name; ``*`` where the data themselves can hardly tell the two."""
    found: Counter[str] = Counter()
    for r in records:
        if not r["truth"] or r.get("exact") or r["family"] in UNEXPLAINED:
            continue
        kind, target = r["truth"][0]
        if r["first"]:
            extra = [k for k, t in r["named"] if (k, t) not in [tuple(x) for x in r["truth"]]]
            taken = "right, and " + (", ".join(extra) if extra else r["verdict"])
        elif r["named"]:
            other, there = r["named"][0]
            taken = f"{other} of {'the same' if there == target else 'another'}{' *' if r['excused'] else ''}"
        else:
            taken = "nothing named, " + r["verdict"]
        found[f"{kind} → {taken}"] += 1
    lines = [f"{n:4d}  {text}" for text, n in found.most_common(most)]
    return "Taken for\n" + "\n".join(lines) if lines else ""


def _errors(records: list[Record]) -> str:
    failed = Counter(
        r["error"].strip().splitlines()[-1][:150] for r in records if r["verdict"] == "error" and r["error"]
    )
    return "Errors\n" + "\n".join(f"{n:4d}  {text}" for text, n in failed.most_common(8)) if failed else ""


def _seconds(records: list[Record]) -> str:
    s = np.array([r["seconds"] for r in records])
    if not len(s):
        return "no record"
    middle, late = np.quantile(s, [0.5, 0.9])
    return f"{len(s)} cases, seconds a verdict: median {middle:.2f}, 90 % {late:.2f}, most {s.max():.2f}"
