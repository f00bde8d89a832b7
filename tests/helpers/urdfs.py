"""Published descriptions of arms as small URDF texts, for Pinocchio: numbers of the makers or of ROS packages."""

from __future__ import annotations

from math import pi

# (name, xyz, rpy, axis, (mass, com) or None), ROS-Industrial, abb_irb120_support/urdf/irb120_3_58_macro.xacro
IRB120 = [
    ("joint_1", (0, 0, 0), (0, 0, 0), (0, 0, 1), (3.067, (9.77e-05, -0.00012, 0.23841))),
    ("joint_2", (0, 0, 0.29), (0, 0, 0), (0, 1, 0), (3.909, (0.00078, -0.00212, 0.10124))),
    ("joint_3", (0, 0, 0.27), (0, 0, 0), (0, 1, 0), (2.944, (0.02281, 0.00106, 0.05791))),
    ("joint_4", (0, 0, 0.07), (0, 0, 0), (1, 0, 0), (1.328, (0.2247, 0.00015, 0.00041))),
    ("joint_5", (0.302, 0, 0), (0, 0, 0), (0, 1, 0), (0.546, (-0.00109, 3.68e-05, 6.22e-05))),
    ("joint_6", (0.072, 0, 0), (0, 0, 0), (1, 0, 0), (0.137, (-0.00706, -0.00017, -1.32e-06))),
    ("tool0", (0, 0, 0), (0, pi / 2, 0), None, None),
]

# ROS-Industrial kuka_experimental, lbr_iiwa_14_r820_macro.xacro; its lateral 0.43624 mm, which the data sheet does not
# have, is left out
IIWA14 = [
    ("joint_a1", (0, 0, 0), (0, 0, 0), (0, 0, 1), None),
    ("joint_a2", (0, 0, 0.36), (0, 0, 0), (0, 1, 0), None),
    ("joint_a3", (0, 0, 0), (0, 0, 0), (0, 0, 1), None),
    ("joint_a4", (0, 0, 0.42), (0, 0, 0), (0, -1, 0), None),
    ("joint_a5", (0, 0, 0), (0, 0, 0), (0, 0, 1), None),
    ("joint_a6", (0, 0, 0.4), (0, 0, 0), (0, 1, 0), None),
    ("joint_a7", (0, 0, 0), (0, 0, 0), (0, 0, 1), None),
    ("tool0", (0, 0, 0.126), (0, 0, 0), None, None),
]


def universal_robots(d1, a2, a3, d4, d5, d6, bodies):
    """Universal Robots' own ROS description, base_link turned by 180 deg to their Base.

    Frames of default_kinematics.yaml, masses and centres of mass of physical_parameters.yaml
    (UniversalRobots/Universal_Robots_ROS2_Description, config/).
    """
    return [
        ("shoulder_pan", (0, 0, d1), (0, 0, 0), (0, 0, 1), bodies[0]),
        ("shoulder_lift", (0, 0, 0), (pi / 2, 0, 0), (0, 0, 1), bodies[1]),
        ("elbow", (a2, 0, 0), (0, 0, 0), (0, 0, 1), bodies[2]),
        ("wrist_1", (a3, 0, d4), (0, 0, 0), (0, 0, 1), bodies[3]),
        ("wrist_2", (0, -d5, 0), (pi / 2, 0, 0), (0, 0, 1), bodies[4]),
        ("wrist_3", (0, d6, 0), (pi / 2, pi, pi), (0, 0, 1), bodies[5]),
    ]


UR5 = universal_robots(0.089159, -0.425, -0.39225, 0.10915, 0.09465, 0.0823, [
    (3.7, (0, -0.00193, -0.02561)), (8.393, (-0.2125, 0, 0.11336)), (2.33, (-0.24225, 0, 0.0265)),
    (1.219, (0, -0.01634, -0.0018)), (1.219, (0, 0.01634, -0.0018)), (0.1879, (0, 0, -0.001159)),
])  # fmt: skip
UR10 = universal_robots(0.1273, -0.612, -0.5723, 0.163941, 0.1157, 0.0922, [
    (7.1, (0.021, -0.027, 0)), (12.7, (-0.232, 0, 0.158)), (4.27, (-0.3323, 0, 0.068)),
    (2.0, (0, -0.018, 0.007)), (2.0, (0, 0.018, -0.007)), (0.365, (0, 0, -0.026)),
])  # fmt: skip
UR5E = universal_robots(0.1625, -0.425, -0.3922, 0.1333, 0.0997, 0.0996, [
    (3.761, (0, -0.00193, -0.02561)), (8.058, (-0.2125, 0, 0.11336)), (2.846, (-0.2422, 0, 0.0265)),
    (1.37, (0, -0.01634, -0.0018)), (1.3, (0, 0.01634, -0.0018)), (0.365, (0, 0, -0.001159)),
])  # fmt: skip
UR10E = universal_robots(0.1807, -0.6127, -0.57155, 0.17415, 0.11985, 0.11655, [
    (7.369, (0.021, -0.027, 0)), (13.051, (-0.2327, 0, 0.158)), (3.989, (-0.33155, 0, 0.068)),
    (2.1, (0, -0.018, 0.007)), (1.98, (0, 0.018, -0.007)), (0.615, (0, 0, -0.026)),
])  # fmt: skip
UR3E = universal_robots(0.15185, -0.24355, -0.2132, 0.13105, 0.08535, 0.0921, [
    (1.98, (0, 0, -0.02)), (3.4445, (-0.11355, 0, 0.1157)), (1.437, (-0.1632, 0, 0.0238)),
    (0.871, (0, -0.01, 0)), (0.805, (0, 0.01, 0)), (0.261, (0, 0, -0.02)),
])  # fmt: skip
UR16E = universal_robots(0.1807, -0.4784, -0.36, 0.17415, 0.11985, 0.11655, [
    (7.369, (0, -0.03, -0.016)), (10.45, (-0.1764, 0, 0.16)), (4.321, (-0.166, 0, 0.065)),
    (2.18, (0, -0.011, -0.009)), (2.033, (0, 0.012, -0.018)), (0.907, (0, 0, -0.044)),
])  # fmt: skip
UR20 = universal_robots(0.2363, -0.862, -0.7287, 0.201, 0.1593, 0.1543, [
    (16.343, (0, -0.0062, -0.061)), (29.632, (-0.3394, 0, 0.2098)), (7.879, (-0.4053, 0, 0.0604)),
    (3.054, (0, -0.0393, -0.0026)), (3.126, (0, 0.0379, -0.0024)), (0.926, (0, 0, -0.0293)),
])  # fmt: skip
UNIVERSAL_ROBOTS = {
    "ur3e": UR3E, "ur5": UR5, "ur10": UR10, "ur5e": UR5E, "ur10e": UR10E, "ur16e": UR16E, "ur20": UR20,
}  # fmt: skip


def urdf_text(rows, limits='<limit lower="-3" upper="3" effort="1" velocity="1"/>'):
    """A URDF of a chain of rows; links are named base, link1, …, and a row without an axis is fixed."""
    parts = ['<robot name="arm">', '<link name="base"/>']
    for i, (name, xyz, rpy, axis, body) in enumerate(rows, 1):
        inertial = ""
        if body:
            com = " ".join(map(str, body[1]))
            inertial = (
                f'<inertial><mass value="{body[0]}"/><origin xyz="{com}"/>'
                '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
            )
        parts.append(f'<link name="link{i}">{inertial}</link>')
        parent = "base" if i == 1 else f"link{i - 1}"
        origin = f'<origin xyz="{" ".join(map(repr, xyz))}" rpy="{" ".join(map(repr, rpy))}"/>'
        ends = f'<parent link="{parent}"/><child link="link{i}"/>'
        moves = f'<axis xyz="{" ".join(map(str, axis))}"/>{limits}' if axis else ""
        parts.append(f'<joint name="{name}" type="{"revolute" if axis else "fixed"}">{origin}{ends}{moves}</joint>')
    return "\n".join([*parts, "</robot>"])
