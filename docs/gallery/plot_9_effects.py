"""
What each effect looks like
===========================

The error of one joint over its value, for six effects of typical size: a compliant joint errs like the torque of
gravity, which in this arm with a horizontal axis is a cosine, as an eccentric gear may be; lost motion makes two
branches, one for each side of approach. What looks alike here is told apart by a second payload, by the whole range
of the joint, or by both sides: :doc:`/reference/effects` says by which.
"""

import matplotlib.pyplot as plt
import numpy as np

import posture_opt as po

JOINT = {"name": "shoulder", "a": "0.5 m", "alpha": "0 deg", "limits": ["-180 deg", "180 deg"], "mass": "4 kg"}
JOINT |= {"com": ["-0.25 m", "0 m", "0 m"]}
ROBOT = {"kind": "dh", "gravity": [0, -9.81, 0], "payload": "5 kg", "joints": [JOINT]}
EFFECTS = {
    "joint scale, 0.01 %": {"kind": "joint_scale", "estimate": {"scale": 1e-4}},
    "gear eccentricity, 0.2 mrad": {"kind": "gear_eccentricity", "estimate": {"sin": "0 mrad", "cos": "0.2 mrad"}},
    "cyclic error, 5 a turn": {"kind": "cyclic_error", "cycles": 5, "estimate": {"sin": "0.1 mrad", "cos": "0 mrad"}},
    "compliance, 8 µrad/(N m)": {"kind": "joint_compliance", "estimate": {"compliance": "8 urad/(N m)"}},
    "backlash, 0.2 mrad": {"kind": "backlash", "estimate": {"width": "0.2 mrad"}},
    "load backlash, 5 µrad/(N m)": {"kind": "load_backlash", "estimate": {"height": "5 urad/(N m)"}},
}
q = np.linspace(-np.pi, np.pi, 400)[:, None]


def joint_error(effects, side):
    """The error of the joint [mrad]: the shift of the tool point along its path, by the length of the arm."""
    task = {"kind": "measure", "position": ["0.5 m", "0 m", "0 m"], "payload": "5 kg", "approach": {"shoulder": side}}
    uncertainty = {"sigma": {"shoulder.theta": "1 mrad"}}
    problem = po.problem_from_dict({"robot": ROBOT, "task": task, "effects": effects, "uncertainty": uncertainty})
    x = po.Arm.from_problem(problem).position(q)
    off = np.arctan2(x[:, 1], x[:, 0]) - q[:, 0]
    return 1e3 * ((off + np.pi) % (2 * np.pi) - np.pi)


figure, axes = plt.subplots(2, 3, figsize=(9, 5), sharex=True, sharey=True, layout="constrained")
for ax, (title, effect) in zip(axes.flat, EFFECTS.items(), strict=True):
    for side, style in ((1, "-"), (-1, "--")):
        ax.plot(np.degrees(q), joint_error([{**effect, "joint": "shoulder"}], side), style, color="C0")
    ax.set_title(title, fontsize=9)
    ax.set_xticks([-180, -90, 0, 90, 180])
    ax.grid(alpha=0.3)
figure.supxlabel("joint value [deg]")
figure.supylabel("joint error [mrad]")
figure.suptitle("Solid: the value was increasing on arrival; dashed: decreasing", fontsize=10)
