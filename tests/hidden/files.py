"""The files of a case, as an engineer would hand them over; the truth is not among them."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import yaml

from tests.hidden.designs import Session
from tests.hidden.draw import Draw
from tests.hidden.mechanics import Arm, Array


def write(case: Draw, folder: Path) -> Path:
    """problem.yaml, data.csv, and where there are such, arm.urdf and test.csv; the problem's path."""
    folder.mkdir(parents=True, exist_ok=True)
    if case.nominal.urdf:
        (folder / "arm.urdf").write_text(case.nominal.urdf)
    problem = folder / "problem.yaml"
    problem.write_text(yaml.safe_dump(document(case), sort_keys=False))
    write_csv(folder / "data.csv", case.nominal, case.session, case.points, case.robots)
    if case.test is not None:
        write_csv(folder / "test.csv", case.nominal, *case.test)
    return problem


def plain(value: object) -> object:
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else str(value)


def document(case: Draw) -> dict:
    arm = case.nominal
    robot: dict = {"kind": arm.kind}
    if arm.kind == "urdf":
        robot["file"] = "arm.urdf"
    else:
        robot["joints"] = [_joint(arm, j) for j in range(arm.n)]
    for prefix, factors in (("base", arm.base), ("tool", arm.tool)):
        xyz, rpy = ([f.value for f in part] for part in (factors[:3], factors[:2:-1]))
        frame = {"xyz": [f"{v!r} m" for v in xyz], "rpy": [f"{v!r} rad" for v in rpy]}
        robot[prefix] = frame | ({"free": True} if case.free else {})
    if case.word:
        robot["base"] = "free"
    robot["gravity"] = [float(v) for v in arm.gravity]
    uncertainty: dict = {"measurement": {"position": f"{case.truth['sigma'] * 1e3:.12g} mm"}}
    if case.priors:
        uncertainty["sigma"] = {name: f"{s * 1e3:.12g} mm" for name, s in case.priors.items()}
    return {"name": f"{arm.name} measured", "robot": robot, "uncertainty": uncertainty}


def _joint(arm: Arm, j: int) -> dict:
    slides = arm.prismatic[j]
    unit = "m" if slides else "rad"
    values = {f.name.rpartition(".")[2]: f.value for f in arm.links[j]}
    row = {"name": arm.joints[j], "type": "prismatic" if slides else "revolute"}
    row |= {key: f"{values[key]!r} {'m' if key in ('a', 'd') else 'rad'}" for key in ("a", "alpha", "d", "theta")}
    row["limits"] = [f"{float(v)!r} {unit}" for v in (arm.lower[j], arm.upper[j])]
    row["mass"] = f"{float(arm.masses[j])!r} kg"
    row["com"] = [f"{float(v)!r} m" for v in arm.coms[j]]
    return row | ({"gear_ratio": float(arm.gear[j])} if arm.gear[j] else {})


def write_csv(path: Path, arm: Arm, session: Session, points: Array, robots: Array | None = None) -> None:
    """Joints in degrees or mm with nine decimals, points in mm with five."""
    columns: dict[str, list[str]] = {}
    for j, name in enumerate(arm.joints):
        head, factor = (f"{name} [mm]", 1e3) if arm.prismatic[j] else (f"{name} [deg]", 180 / np.pi)
        columns[head] = [f"{v:.9f}" for v in session.q[:, j] * factor]
    for axis in arm.measured:
        columns[f"{'xyz'[axis]} [mm]"] = [f"{v:.5f}" for v in points[:, axis] * 1e3]
    columns["pose"] = [f"p{int(v)}" for v in session.pose]
    if robots is not None:
        columns["robot"] = [str(v) for v in robots]
    if session.sides_stated:
        for j, name in enumerate(arm.joints):
            columns[f"{name}.approach"] = [f"{int(np.sign(v))}" for v in session.side[:, j]]
    if session.payload_logged:
        columns["payload [kg]"] = [f"{v:g}" for v in session.payload]
    if session.logged:
        columns["temperature [degC]"] = [f"{v:.2f}" for v in session.temperature]
        columns["time [s]"] = [f"{v:.2f}" for v in session.time]
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows(zip(*columns.values(), strict=True))
