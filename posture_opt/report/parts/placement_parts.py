"""What reports say of several features: a posture each, the placement, what others cost, the order of visits."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.report.page.presenter import Columns
from posture_opt.report.parts.parts import joint_columns, joint_heads, point_columns
from posture_opt.report.parts.task_parts import critical_size
from posture_opt.report.text.blocks import Block, Facts, Table
from posture_opt.report.text.words import direction_words
from posture_opt.selection.answer.placement import COORDINATES, PlacementFigure, placement_text
from posture_opt.statements.notation import (
    angle,
    joint_unit,
    length,
    length_unit,
    percent,
    place,
    probability,
    stated_angle,
    stated_length,
)
from posture_opt.uncertainty.joint_digits import readable_digits
from posture_opt.units import fixed, number

if TYPE_CHECKING:
    from posture_opt.selection.answer.placement import Placement
    from posture_opt.selection.answer.solution import Solution


def placement_of(found: Solution) -> Placement:
    """The placement of an answer that has one."""
    assert found.placement is not None
    return found.placement


def features_facts(found: Solution) -> list[tuple[str, str]]:
    """How many features are asked for, and where the workpiece may stand."""
    placement, texts = placement_of(found), []
    for k, name in enumerate(COORDINATES):
        write = stated_angle if k == 3 else stated_length
        low, high = write(float(placement.lower[k])), write(float(placement.upper[k]))
        texts.append(f"{name} {low} to {high}" if placement.free[k] else f"{name} {low}")
    return [
        ("Direction", f"{direction_words(np.array(found.task.direction))} in the frame of the workpiece"),
        ("Features", f"{len(found.names)}, in one placement of the workpiece"),
        ("Range", ", ".join(texts)),
    ]


def _sigma_unit(found: Solution) -> tuple[str, float]:
    return length_unit([float(s) for s in found.sigmas])


def features_block(found: Solution) -> Block:
    """A posture for each feature."""
    joints = found.optimisation_problem.robot.joints
    digits = readable_digits(found.problem, found.postures)
    unit, factor = _sigma_unit(found)
    p_success = [station.success_probability for station in found.stations]
    known = all(p is not None for p in p_success)
    headers = ["feature", f"std. dev. [{unit}]", *(["success [%]"] if known else [])]
    headers += joint_heads(found.optimisation_problem.robot)
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
    return "" if p is None else probability(p).removesuffix(" %")


def placements_block(found: Solution) -> Block:
    """What other placements cost; nothing where there is no choice."""
    if not placement_of(found).free.any():
        return Block("Placements", ())
    this = PlacementFigure(found.w, found.sigma, None if found.success is None else found.success.probability)
    named = [("centre of the range", found.centre), ("typical (median tried)", found.typical)]
    shown = [("this one", this), *((name, other) for name, other in named if other is not None)]
    shown += [("another optimum", other) for other in found.others]
    unit, factor = _sigma_unit(found)
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
    return Block("Placements", (Table(headers, tuple(rows)),), figure="bench")


def order_block(found: Solution) -> Block:
    """In which order to visit the features, and how far joints travel."""
    if len(found.names) < 2:
        return Block("Visiting order", ())
    order = found.order
    turning = any(joint.type == "revolute" for joint in found.optimisation_problem.robot.joints)
    travel, listed = map(angle if turning else length, (order.travel, order.as_listed))
    proof = "shortest possible" if order.exact else "found by exchanges"
    rows = (("Order", ", ".join(found.names[k] for k in order.order)),
            ("Joint travel", f"{travel} ({proof}); {listed} in file order"))  # fmt: skip
    return Block("Visiting order", (Facts(rows),))


def features_checks(found: Solution) -> Block:
    """How near the arm comes to anything, and what the search did."""
    e = placement_of(found).statistics
    assert e is not None
    nearest = found.clearance
    rows = [] if nearest is None else [
        ("Clearance", f"at least {length(nearest.distance)}, between {' and '.join(nearest.between)}")
    ]  # fmt: skip
    if placement_of(found).free.any():
        rows.append(("Search", f"{e.placements} placements, {e.feasible} feasible for all; {e.solves} joint solves"))
        rows.append(("Best found", f"by {e.recurred} of {e.batches} independent batches"))
    else:
        rows.append(("Search", f"each feature on its own: {e.starts} random starts in {e.batches} batches"))
    return Block("Checks", (Facts((*rows, ("Time", f"{e.seconds:.2f} s"))),), brief=())


def features_figures(found: Solution) -> list[tuple[str, str]]:
    """The placement and the worst feature."""
    facts = [("Workpiece", placement_text(found.w, placement_of(found))),
             ("Worst feature", f"{found.worst_station}, {critical_size(found.worst.critical)}")]  # fmt: skip
    if found.success is not None:
        facts.append(("All succeed", probability(found.success.probability)))
    return facts


def features_columns(found: Solution) -> Columns:
    """A row for each feature."""
    stations = found.stations
    return {
        "feature": list(found.names[: len(stations)]),
        **joint_columns(found.optimisation_problem.robot, np.array([station.q for station in stations])),
        **point_columns(np.array([station.spread.position for station in stations])),
        "sigma_max [mm]": (1e3 * found.sigmas).tolist(),
    }
