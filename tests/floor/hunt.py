"""Fresh draws of each circumstance through the public door: ``python -m tests.floor.hunt --draws 20 --seed 3``.

One line a draw, and behind them a table: verdicts, false causes, sizes within two standard errors, kept promises.
"""

from __future__ import annotations

import argparse
import json
import sys
import warnings
import zlib
from typing import Any

import numpy as np

from tests.floor.circumstances import CIRCUMSTANCES, Case

GEOMETRIC = ("geometry", "joint_offset", "link_length", "link_offset", "link_twist", "axis_tilt")
GEOMETRIC += ("base_frame", "tool_frame")


def draw(name: str, seed: int, index: int) -> Case:
    return CIRCUMSTANCES[name](np.random.default_rng([seed, zlib.crc32(name.encode()), index]))


def ask(case: Case) -> dict[str, Any]:
    """The document of the diagnosis."""
    import posture_opt as po

    problem = po.problem_from_dict(case.document)
    test = None if case.fresh is None else po.read_measurements(case.fresh, problem)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = po.diagnose(problem, po.read_measurements(case.table, problem), plan=False, test=test)
    return json.loads(json.dumps(found.to_json()))


def size(estimate: dict[str, Any]) -> dict[str, float] | None:
    """The first parameter, or of a frame that turns the length of its turn; None of products with unknown masses."""
    turn = [estimate[name] for name in ("roll", "pitch", "yaw") if name in estimate]
    if not turn:
        return next((value for name, value in estimate.items() if not name.startswith("mass at")), None)
    return {"value": float(np.linalg.norm([t["value"] for t in turn])), "std": max(t["std"] for t in turn)}


def score(case: Case, answer: dict[str, Any]) -> dict[str, Any]:
    """What is right of an answer: ``z`` of sizes, ``false`` causes, whether the verdict is open where it has to be."""
    named = [e for e in answer["effects"] if e["kind"] not in GEOMETRIC]
    sizes = {(e["kind"], e["target"]): size(e["estimate"]) for e in named}
    false = [who for who in sizes if who not in case.causes and who[0] != "outliers"]
    z = [
        (sizes[who]["value"] - true) / sizes[who]["std"]
        for who, true in case.sizes.items()
        if sizes.get(who) is not None
    ]
    found = any(who in case.causes for who in sizes)
    right = (answer["verdict"] == "unexplained" or found) if case.unexplained else found or not case.causes
    promise = answer["residual_rms"]["delivered_heldout"]
    fresh = answer.get("test")
    return {
        "verdict": answer["verdict"], "right": right, "false": [f"{k} {t}" for k, t in false],
        "z": [round(v, 1) for v in z], "named": [f"{k} {t}" for k, t in sizes],
        "p": answer["unexplained"]["p_value"],
        "promise": None if fresh is None else round(fresh["extended"]["rms"] / promise, 2),
        "worse": None if fresh is None else round(fresh["extended"]["rms"] / fresh["nominal"]["rms"], 2),
        "doubts": answer.get("doubts"), "gravity": answer.get("gravity"), "masses": answer.get("masses"),
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=5)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=3)
    parser.add_argument("--names", nargs="+", default=list(CIRCUMSTANCES), choices=list(CIRCUMSTANCES))
    parser.add_argument("--quiet", action="store_true")
    options = parser.parse_args()
    table = []
    for name in options.names:
        scores = []
        for index in range(options.first, options.first + options.draws):
            case = draw(name, options.seed, index)
            try:
                found = score(case, ask(case))
            except Exception as error:  # a refusal is an answer too
                found = {"verdict": type(error).__name__, "right": False, "false": [], "z": [], "text": str(error)}
            scores.append(found)
            if not options.quiet:
                print(name, index, json.dumps(found), flush=True)
        z = [v for s in scores for v in s["z"]]
        promises = [s["promise"] for s in scores if s.get("promise")]
        table.append(
            f"{name:22} right {sum(s['right'] for s in scores)}/{len(scores)}  false causes in "
            f"{sum(bool(s['false']) for s in scores)}  unexplained {sum(s['verdict'] == 'unexplained' for s in scores)}"
            f"  sizes within 2: {sum(abs(v) < 2 for v in z)}/{len(z)}  fresh/promise {np.round(promises, 2).tolist()}"
        )
    print("\n".join(table), file=sys.stdout)


if __name__ == "__main__":
    main()
