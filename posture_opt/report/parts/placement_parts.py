"""What reports say of several features: a posture each, the placement, what others cost, the order of visits."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.numerics import Array
from posture_opt.report.parts.parts import sentence
from posture_opt.report.parts.solution_checks import confirmation_words
from posture_opt.report.parts.task_parts import critical_size
from posture_opt.report.text.blocks import Block, Facts, Summary, Table
from posture_opt.report.text.words import direction_words, part_words
from posture_opt.selection.answer.placement import COORDINATES
from posture_opt.selection.answer.shared_placement import PlacementFigure
from posture_opt.statements.notation import (
    angle,
    count,
    joint_unit,
    length,
    length_unit,
    percent,
    place,
    probability,
    short_probability,
    stated_angle,
    stated_length,
)
from posture_opt.uncertainty.spread.joint_digits import readable_digits
from posture_opt.units import fixed, number

if TYPE_CHECKING:
    from posture_opt.selection.answer.placement import PlacementRange
    from posture_opt.selection.answer.shared_placement import Placement, PlacementStatistics
    from posture_opt.selection.answer.solution import Solution

_PROBABILITY_TOLERANCE = 1e-4  # of a probability: what a report tells apart
_GAIN_TOLERANCE = 5e-4  # of a standard deviation: less is no difference
COMBINED = {
    "worst": "the largest of all features",
    "mean": "the mean of all features",
    "success": "the probability of missing any feature",
}


def placement_of(found: Solution) -> Placement:
    """The placement of an answer that has one."""
    assert found.placement is not None
    return found.placement


def statistics_of(found: Solution) -> PlacementStatistics:
    """How the placement was searched for."""
    statistics = placement_of(found).statistics
    assert statistics is not None
    return statistics


def is_free(found: Solution) -> bool:
    """Whether there was a choice of placement."""
    return bool(placement_of(found).free.any())


def placement_words(w: Array, placement: PlacementRange | None = None) -> str:
    """A placement in a line: x 512.0 mm, y -20.0 mm, z 100.0 mm, yaw 12.00 deg; at which ends of its range it lies."""
    texts = []
    for k, name in enumerate(COORDINATES):
        text = f"{name} {angle(float(w[k])) if k == 3 else f'{fixed(1e3 * float(w[k]), 1)} mm'}"
        if placement is not None and not placement.free[k]:
            text += " (fixed)"
        elif placement is not None and not (k == 3 and placement.all_round):
            at_end = min(w[k] - placement.lower[k], placement.upper[k] - w[k]) < 1e-9
            text += " (end of its range)" * bool(at_end)
        texts.append(text)
    return ", ".join(texts)


def features_lead(found: Solution) -> tuple[str, ...]:
    """The placement, the worst feature, and what placing the workpiece gained."""
    worst = found.worst
    name = found.worst_station
    moved = is_free(found)
    where = "Place the workpiece at" if moved else "The workpiece stands at"
    lines = [f"{where} {placement_words(found.w, placement_of(found))}."]
    part = part_words(worst.critical.within, found.task.kind)
    worst_of = f"Standard deviation {part} at the worst of {count(len(found.names), 'feature')}, {name}"
    lines.append(f"{worst_of}: {critical_size(worst.critical)}.")
    if found.task.combine == "mean":
        lines.append(f"Mean over the features: {length(found.sigma)}.")
    typical = found.typical if moved else None
    if typical is not None and typical.success is None:
        lines.append(f"This is {gain_words(found, typical)} at a typical feasible placement.")
    if found.success is not None:
        lines.append(f"Probability that all features succeed: {success_words(found)}{_typical_success(typical)}.")
    if found.status != "optimal":
        lines.append("The solver did not confirm an optimum; this is the best placement found.")
    return tuple(lines)


def no_placement_lead(found: Solution) -> tuple[str, ...]:
    """Where the features fail least."""
    looked = statistics_of(found).placements
    where = f"No placement was found at which every feature is feasible ({looked:,} tried). The nearest is at"
    if not is_free(found):
        where = "Not every feature is feasible with the workpiece"
    return (f"{where} {placement_words(found.w, placement_of(found))}.",)


def success_words(found: Solution) -> str:
    """The probability that all features succeed."""
    success = found.success
    assert success is not None
    text = probability(success.probability)
    if success.standard_error > 0:
        text += f" (standard error {number(100 * success.standard_error, 2)} %)"
    return text


def _typical_success(typical: PlacementFigure | None) -> str:
    """The probability at a typical placement, in brackets."""
    if typical is None or typical.success is None:
        return ""
    return f" ({probability(typical.success)} at a typical feasible placement)"


def gain_words(found: Solution, other: PlacementFigure) -> str:
    """The standard deviation beside that of another placement."""
    gain = 1 - found.sigma / other.sigma
    if abs(gain) < _GAIN_TOLERANCE:
        return "the same as"
    return f"{percent(abs(gain))} {'lower' if gain > 0 else 'higher'} than"


def features_facts(found: Solution) -> list[tuple[str, str]]:
    """How many features are asked for, and where the workpiece may stand."""
    return [
        ("Direction", f"{direction_words(np.array(found.task.direction))} in the frame of the workpiece"),
        ("Features", f"{len(found.names)}, in one placement of the workpiece"),
        ("Range", range_words(placement_of(found))),
    ]


def range_words(placement: PlacementRange) -> str:
    """Where the workpiece may stand."""
    texts = []
    for k, name in enumerate(COORDINATES):
        write = stated_angle if k == 3 else stated_length
        low, high = write(float(placement.lower[k])), write(float(placement.upper[k]))
        texts.append(f"{name} {low} to {high}" if placement.free[k] else f"{name} {low}")
    return ", ".join(texts)


def sigma_unit(found: Solution) -> tuple[str, float]:
    """The unit of all standard deviations of the report, and the factor from m to it: that of the answer."""
    return length_unit([float(s) for s in found.sigmas])


def features_block(found: Solution) -> Block:
    """A posture for each feature."""
    joints = found.optimisation_problem.robot.joints
    digits = readable_digits(found.problem, found.postures)
    unit, factor = sigma_unit(found)
    p_success = [station.success_probability for station in found.stations]
    known = all(p is not None for p in p_success)
    headers = ["feature", f"std. dev. [{unit}]", *(["success [%]"] if known else [])]
    headers += [f"{joint.name} [{joint_unit(joint.type)[0]}]" for joint in joints]
    rows = []
    for k, (name, station) in enumerate(zip(found.names, found.stations, strict=True)):
        row = [name, number(float(found.sigmas[k]) * factor), *([_share(p_success[k])] if known else [])]
        row += [digits.text(j, v, 1 / joint_unit(j.type)[1]) for v, j in zip(station.q, joints, strict=True)]
        rows.append(tuple(row))
    views = tuple(f"feature-{k}" for k in range(1, len(rows) + 1))
    table = Table(tuple(headers), tuple(rows), views=views, worst=found.worst_index)
    points = Table(("feature", "tool point in the world"), tuple(
        (name, place(station.spread.position)) for name, station in zip(found.names, found.stations, strict=True)
    ), 2, views)  # fmt: skip
    return Block("A posture for each feature", (table, points), figure="arm")


def _share(p: float | None) -> str:
    """A probability in percent, as tables have it."""
    return "" if p is None else short_probability(p).removesuffix(" %")


def placements_block(found: Solution) -> Block:
    """What other placements cost; nothing where there is no choice."""
    if not is_free(found):
        return Block("Placements", ())
    this = PlacementFigure(found.w, found.sigma, None if found.success is None else found.success.probability)
    named = [("centre of the range", found.centre), ("typical (median tried)", found.typical)]
    shown = [("this one", this), *((name, other) for name, other in named if other is not None)]
    shown += [("another optimum", other) for other in found.others]
    unit, factor = sigma_unit(found)
    p_success = found.task.combine == "success"
    what = "mean std. dev." if found.task.combine == "mean" else "worst std. dev."
    rows = []
    for name, other in shown:
        size = number(other.sigma * factor) if math.isfinite(other.sigma) else "not feasible"
        more = percent(other.sigma / found.sigma - 1) if math.isfinite(other.sigma) and other is not this else "-"
        place_of = (*(fixed(1e3 * float(v), 1) for v in other.w[:3]), fixed(math.degrees(other.w[3]), 2))
        rows.append((name, *((_share(other.success), size) if p_success else (size, more)), *place_of))
    measures = ("all succeed [%]", f"{what} [{unit}]") if p_success else (f"{what} [{unit}]", "difference")
    headers = ("placement", *measures, "x [mm]", "y [mm]", "z [mm]", "yaw [deg]")
    return Block("Placements", (Table(headers, tuple(rows)), *_base_sentence(found)), figure="bench")


def _base_sentence(found: Solution) -> tuple[str, ...]:
    """The same seen from the part, for a base that is to be moved instead."""
    c, s = math.cos(found.w[3]), math.sin(found.w[3])
    x, y, z = -found.w[:3]
    origin = (c * x + s * y, -s * x + c * y, z)
    turned = angle(math.remainder(-float(found.w[3]), 2 * math.pi))
    return (
        f"To move the robot instead of the part: place the world origin, in which its base is stated, at "
        f"{place(origin)} in the workpiece frame, rotated by {turned} about z.",
    )


def order_block(found: Solution) -> Block:
    """In which order to visit the features."""
    if len(found.names) < 2:
        return Block("Visiting order", ())
    order = found.order
    turning = any(joint.type == "revolute" for joint in found.optimisation_problem.robot.joints)

    def travel(value: float) -> str:
        """A way of joints: an angle, or a length where all joints slide."""
        return angle(value) if turning else length(value)

    listed = "file order" if order.order == tuple(range(len(found.names))) else "this order"
    saved = order.as_listed - order.travel
    gain = f", {travel(order.as_listed)} in file order" if saved > 1e-9 else ""
    proof = "shortest possible" if order.exact else "found by exchanges; a shorter one may exist"
    rows = (
        ("Order", ", ".join(found.names[k] for k in order.order)),
        (
            "Joint travel",
            f"{travel(order.travel)} in {listed}{gain} (sum over the moves of the largest joint motion; {proof})",
        ),
    )
    return Block("Visiting order", (Facts(rows),))


def features_checks(found: Solution) -> Block:
    """What the search did, and how the probability was found."""
    e = statistics_of(found)
    rows: list[tuple[str, str]] = []
    if found.success is not None and abs(found.success.product - found.success.probability) > _PROBABILITY_TOLERANCE:
        rows.append(("Together", f"constant errors are shared by all features; if they were independent, the "
                                 f"probability would be {probability(found.success.product)}"))  # fmt: skip
    if found.task.combine == "success":
        rows.append(("Compared", "optima for the product of the probabilities, for the worst and for the mean scatter, "
                                 "by the probability that all succeed"))  # fmt: skip
    if found.clearance is not None:
        between = " and ".join(found.clearance.between)
        rows.append(("Clearance", f"at least {length(found.clearance.distance)}, between {between}"))
    if is_free(found):
        rows.append(("Search", f"{e.placements} placements, {e.feasible} of them feasible for all features; "
                               f"{count(e.solves, 'joint solve')} by IPOPT"))  # fmt: skip
        rows.append(("", f"the best optimum was found by {e.recurred} of {e.batches} independent batches"))
    else:
        rows.append(("Search", f"each feature on its own: {count(e.starts, 'random start')} in {e.batches} batches"))
    if found.confirmation is not None:
        rows.append(("", confirmation_words(found.confirmation)))
    rows.append(("Time", f"{e.seconds:.2f} s"))
    return Block("Checks", (Facts(tuple(rows)),))


def features_summary(found: Solution) -> Summary:
    """The placement and the worst feature."""
    asked = found.problem.name or found.task.kind
    if found.status == "infeasible":
        why = sentence(found.reasons[0].message) if found.reasons else "no placement fits"
        facts = [("Workpiece", f"fails least at {placement_words(found.w)}"), ("Why", why)]
        return Summary(f"No placement for: {asked}", tuple(facts))
    name = found.worst_station
    facts = [
        ("Workpiece", placement_words(found.w)),
        ("Worst feature", f"{name}, {critical_size(found.worst.critical)}"),
    ]
    if found.success is not None:
        facts.append(("All succeed", success_words(found)))
    if found.typical is not None and found.typical.success is None:
        facts.append(("Gain", f"{gain_words(found, found.typical)} at a typical placement"))
    word = "Best placement" if is_free(found) else "Best postures"
    return Summary(f"{word} of: {asked}", tuple(facts))


def features_columns(found: Solution) -> dict[str, list[object]]:
    """A row for each feature."""
    joints = {joint.name: joint_unit(joint.type) for joint in found.optimisation_problem.robot.joints}
    stations = found.stations
    points = np.array([station.spread.position for station in stations])
    return {
        "feature": list(found.names[: len(stations)]),
        **{f"{name} [{unit}]": [s.posture[name] * k for s in stations] for name, (unit, k) in joints.items()},
        **{f"{c} [mm]": (1e3 * points[:, i]).tolist() for i, c in enumerate("xyz")},
        "sigma_max [mm]": (1e3 * found.sigmas).tolist(),
    }
