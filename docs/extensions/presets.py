"""The table of presets, read off their files."""

from __future__ import annotations

import yaml

from posture_opt.robot.preset import preset_names, preset_text


def presets_table() -> str:
    """Name, robot, convention and the source of the geometry."""
    rows = ["| name | robot | convention | joints | geometry from |", "| --- | --- | --- | --: | --- |"]
    for name in preset_names():
        preset = yaml.safe_load(preset_text(name))
        source = " ".join(preset["source"]["geometry"].split())
        joints = len(preset["robot"]["joints"])
        rows.append(f"| `{name}` | {preset['title']} | `{preset['robot']['kind']}` | {joints} | {source} |")
    return "\n".join(rows) + "\n"
