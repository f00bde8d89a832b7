"""The table of how much is accepted, read off the list of limits."""

from __future__ import annotations

from posture_opt.limits import LIMITS


def limits_table() -> str:
    """What, where, how many are accepted, what one of them costs, and what to do with more."""
    rows = ["| of | at | accepted | one costs | with more |", "| --- | --- | --: | --- | --- |"]
    for limit in LIMITS:
        most = f"{limit.most:,}".replace(",", " ")
        rows.append(f"| {limit.what} | {limit.where} | {most} | {limit.cost} | {limit.hint} |")
    return "\n".join(rows) + "\n"
