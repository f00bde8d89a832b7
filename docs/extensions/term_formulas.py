"""The reference of the terms: the formula of each typeset, its symbols, when to use it, and an entry of a file."""

from __future__ import annotations

from posture_opt.selection.terms import TERMS

FORMULAS = {  # kind -> formula, its own symbols, when to use it, an entry of a file
    "spread": (
        r"s = \sqrt{\lambda_{\text{max}}(B^{\mathsf{T}} C B)}",
        "B: unit vectors of the part that counts, two across the direction, one along it, or all three",
        "A task looks at one part of the scatter only: use it to bound another, such as the depth of an insertion.",
        "subject_to: [{kind: spread, within: along, at_most: 0.3 mm}]",
    ),
    "orientation_spread": (
        r"s = \sqrt{\lambda_{\text{max}}(B^{\mathsf{T}} J_\omega\, \Sigma\, J_\omega^{\mathsf{T}} B)}",
        "J_ω: rotation of the tool per unit of each parameter; B: both directions across the tool axis (`tilt`), the "
        "axis itself (`spin`), or all three (`all`)",
        "The tool has to stay upright, or a part in its yaw, whatever the position of its point.",
        "subject_to: [{kind: orientation_spread, of: tilt, at_most: 0.1 deg}]",
    ),
    "success": (
        r"\ln P(\lVert e \rVert > c) \le \ln (1 - p)",
        "e: error of the tool point in the part that counts, its mean included; c: `clearance`; p: `at_least`",
        "The probability of success is a requirement, and something else is minimised. `criterion: miss` minimises the "
        "probability of a miss itself.",
        "subject_to: [{kind: success, at_least: 0.8}]",
    ),
    "limit_margin": (
        r"q_i - q_i^{\text{min}} \ge m, \qquad q_i^{\text{max}} - q_i \ge m",
        "qᵢ: every revolute joint; m: `at_least`",
        "The controller must have room to move on, or the limits are not known exactly. In `minimize` it draws joints "
        "to the middle of their ranges.",
        "subject_to: [{kind: limit_margin, at_least: 5 deg}]",
    ),
    "link_height": (
        r"z_i(q) \ge h",
        "zᵢ: height of the end of link i, world; h: `at_least`, half the thickness of the links included",
        "A table is below, and the shape of the arm is not known. Where it is known, state the table as an obstacle.",
        "subject_to: [{kind: link_height, at_least: 50 mm}]",
    ),
    "singularity_margin": (
        r"\sigma_{\text{min}}(J) \ge s",
        "J = ∂p/∂q: Jacobian of the tool point; σ_min: its smallest singular value",
        "The tool must be able to move in every direction from there, as for guiding by hand or force control.",
        "subject_to: [{kind: singularity_margin, at_least: 0.15 m}]",
    ),
    "manipulability": (
        r"w = \det (J J^{\mathsf{T}})^{1/2r} \ge w_0",
        "J (r × n): Jacobian of the tool point in its r directions; w: geometric mean of its singular values "
        "(Yoshikawa 1985 has the r-th power)",
        "As `singularity_margin`, for the mean of all directions, or to compare with planners that maximise it.",
        "minimize: [{kind: manipulability, weight: 0.1}]",
    ),
    "joint_torque": (
        r"\lvert \tau_i \rvert \le \tau_i^{\text{max}}, \qquad "
        r"\tau_i = \sum_k m_k \bigl(a_i \times (x_k - o_i)\bigr) \cdot g",
        "mₖ, xₖ: masses behind joint i and the payload, with their places; aᵢ, oᵢ: its axis and a point on it; "
        "g: gravity",
        "A heavy payload far out. The masses of the links have to be in the file; a URDF has them.",
        "subject_to: [{kind: joint_torque, at_most: {shoulder_lift: 150 N m}}]",
    ),
    "near_posture": (
        r"\sqrt{\tfrac{1}{k} \sum_i (q_i - w_i)^2} \le d \;\;\text{or}\;\; \lvert q_i - w_i \rvert \le d_i",
        "wᵢ: the preferred values of k joints, strokes divided by the length of the arm; d: `at_most`",
        "A program exists already, cables hold, or the arm comes from a known posture.",
        "subject_to: [{kind: near_posture, posture: {shoulder_pan: 20 deg, elbow: -90 deg}, at_most: 30 deg}]",
    ),
    "fixed_joints": (
        r"q_i = v_i",
        "vᵢ: the value at which joint i is held",
        "An axis is locked, or must not move. The search has that much less freedom.",
        "subject_to: [{kind: fixed_joints, values: {wrist_3: 30 deg}}]",
    ),
}


def terms_page() -> str:
    """Every kind in the order of `optimize-posture list`; a kind without a formula here is an error."""
    return "\n".join(_entry(term) for term in TERMS)


def _entry(term: type) -> str:
    kind = term.model_fields["kind"].annotation.__args__[0]
    formula, symbols, use, entry = FORMULAS[kind]
    summary = term.summary[0].upper() + term.summary[1:]
    picture = f"![{kind}](/generated/pictures/term_{kind}.png)"
    parts = [f"## `{kind}`", f"{summary}.", f"$$\n{formula}\n$$", f"{symbols}.", picture]
    example = f"```yaml\ntask:\n  {entry}\n```"
    return "\n\n".join([*parts, f"**When to use.** {use}", example]) + "\n"
