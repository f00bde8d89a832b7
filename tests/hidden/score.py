"""One answer against the truth: what was named, whether it is right, and whether its sizes hold."""

from __future__ import annotations

from typing import Any

from tests.hidden.families import GEOMETRY
from tests.hidden.rivals import MARGIN

GEOMETRIC = {*GEOMETRY, "base_frame", "tool_frame", "geometry"}
WIDTH = 1.96
Name = tuple[str, str]
Json = dict[str, Any]


def score(truth: Json, answer: Json | None, seconds: float = 0.0, error: str = "") -> Json:
    """A flat record of one case; ``answer`` is the document of INTERFACE's ``diagnosis.json``."""
    true = [_name(e) for e in truth["effects"] if e["kind"] != "instrument_scale"]
    geometric = any(kind in GEOMETRY for kind, _ in true)
    record: Json = {key: truth[key] for key in ("family", "seed", "index", "arm")}
    strength = [25.0 * e["lambda"] / e.get("needed", 25.0) for e in truth["effects"]]
    record |= {"truth": true, "strength": strength, "seconds": seconds, "error": error}
    if answer is None:
        return record | {"verdict": "error", "named": [], "geometry": []}
    kept = GEOMETRY if geometric else set()
    named = [e for e in answer["effects"] if e["kind"] in kept or e["kind"] not in GEOMETRIC]
    names = [_name(e) for e in named]
    sets = [{_name(e), *map(_name, e.get("confounded_with", ()))} for e in named]
    record |= {
        "verdict": answer["verdict"],
        "named": names,
        "confounded": [sorted(s - {n}) for s, n in zip(sets, names, strict=True)],
    }
    record["geometry"] = [_name(e) for e in answer["effects"] if e["kind"] in GEOMETRIC]
    record |= _right(true, names, sets, answer["verdict"])
    rivals = {_name(r) for e in truth["effects"] for r in e.get("rivals", ()) if r["lost"] < MARGIN}
    record["separable"] = not rivals
    record["excused"] = bool(names) and names[0] in rivals
    record |= _sizes(truth, answer) | _second(true, answer)
    extended = (answer.get("residual_rms") or {}).get("extended")
    if extended and truth.get("rms") and not truth["gross_rows"]:
        record["rms_ratio"] = extended / truth["rms"]
    return record


def _name(e: Json) -> Name:
    return e["kind"], e["target"]


def _right(true: list[Name], names: list[Name], sets: list[set[Name]], verdict: str) -> Json:
    first = bool(names) and names[0] in true
    found = verdict == "effects_found" if true else verdict in ("none_found", "effects_found")
    exact = found and sorted(names) == sorted(true)
    told = set().union(*sets) if sets else set()
    inside = set(true) <= told and all(s & set(true) for s in sets) if true else not names
    return {
        "first": first, "exact": exact, "inside": exact or (found and inside),
        "first_inside": first or bool(sets and sets[0] & set(true)), "all_named": set(true) <= set(names),
        "extra": len(set(names) - set(true)),
    }  # fmt: skip


def _second(true: list[Name], answer: Json) -> Json:
    """What the second session, where there is one, says of the gain: RMS with and without, and what is claimed.

    A gain is claimed where its 95 % interval lies above zero; ``lasting`` are the hidden effects rightly named that
    another session can have, each with its own gain there.
    """
    test = answer.get("test")
    if not test:
        return {}
    gains = [e["test_gain"]["value"] for e in answer["effects"] if _name(e) in true and "test_gain" in e]
    claimed = test["gain"]["interval95"][0] > 0.0
    rms = {model: test[model]["rms"] for model in ("nominal", "calibrated", "extended")}
    return {"second": {"rms": rms, "claimed": claimed, "lasting": gains}}


def _sizes(truth: Json, answer: Json) -> Json:
    """How many estimates of rightly named effects hold the truth within their 95 % interval."""
    held = total = 0
    for e in truth["effects"]:
        for found in answer["effects"]:
            if _name(found) == _name(e):
                for value, true in _pairs(e, found.get("estimate", {})):
                    total += 1
                    held += abs(value["value"] - true) <= WIDTH * value["std"]
    return {"sizes_held": held, "sizes": total}


NONLINEAR = {"cyclic_error", "quantisation", "outliers", "range_noise", "joint_noise", "instrument_field"}


def _pairs(e: Json, estimate: Json) -> list[tuple[Json, float]]:
    """Estimates beside true sizes: by name where names agree, else by order where both count the same."""
    if e["kind"] in NONLINEAR or (e["kind"] == "drift" and e["target"] == "exponential"):
        return []  # shapes are estimated too, so that coefficients are not alike
    usable = {k: v for k, v in estimate.items() if isinstance(v, dict) and (v.get("std") or 0.0) > 0.0}
    size = e["size"]
    if set(usable) & set(size) and len(size) > 1:
        return [(usable[k], size[k]) for k in size if k in usable]
    linear = list(usable.values())
    if e["kind"] in GEOMETRY or len(linear) == len(size):
        return list(zip(linear, size.values(), strict=False))
    return []
