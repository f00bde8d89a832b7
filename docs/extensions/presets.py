"""The table of presets, read off their files."""

from __future__ import annotations

import yaml

from posture_opt.files import preset_names
from posture_opt.robot.preset import preset_text


def presets_table() -> str:
    """Name, robot, convention, rated payload, repeatability and the source of the geometry."""
    head = "| name | robot | convention | joints | payload | repeatability | geometry from |"
    rows = [head, "| --- | --- | --- | --: | --: | --: | --- |"]
    for name in preset_names():
        preset = yaml.safe_load(preset_text(name))
        source = " ".join(preset["source"]["geometry"].split())
        joints = len(preset["robot"]["joints"])
        payload, given = preset.get("rated_payload", {}).get("value", ""), preset.get("repeatability", {})
        repeats = given.get("value", "") + ("" if given.get("verified", True) else " \\*")
        kind = preset["robot"]["kind"]
        rows.append(f"| `{name}` | {preset['title']} | `{kind}` | {joints} | {payload} | {repeats} | {source} |")
    return "\n".join([*rows, "", "\\* written down without the data sheet at hand"]) + "\n"
