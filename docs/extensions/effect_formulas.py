"""The reference of the effects: the formula of each typeset, and what the catalogue says of it."""

from __future__ import annotations

from effect_uses import USES

from posture_opt.errors import enumerated
from posture_opt.model.effects import CATALOGUE
from posture_opt.model.effects.base.cause import INPUTS, CatalogueEntry

FORMULAS = {  # kind -> formula, and what its own symbols are
    "joint_scale": (r"\Delta q = c\,q", "c: the relative error of the gear ratio or of the encoder's counts"),
    "gear_eccentricity": (r"\Delta q = a\,\sin q + b\,\cos q", "√(a² + b²): the amplitude"),
    "gear_second_harmonic": (r"\Delta q = a\,\sin 2q + b\,\cos 2q", "√(a² + b²): the amplitude"),
    "gear_ripple": (
        r"\Delta q = a\,\sin (n N q) + b\,\cos (n N q)",
        "N: motor turns per turn of the joint; n: cycles per turn of the motor, 1 or 2",
    ),
    "cyclic_error": (
        r"\Delta q = \sum_i a_i\,\sin k_i (q - q_0) + b_i\,\cos k_i (q - q_0)",
        "kᵢ: cycles per turn of the joint; q₀: the middle of the measured range",
    ),
    "joint_compliance": (
        r"\Delta q = c\,\tau(q, m)",
        "τ: torque of gravity on the joint from links and payload m; c = 1 / stiffness",
    ),
    "link_bending": (
        r"\varphi = c\,M_\perp, \qquad \Delta p = \varphi \times \ell / 2",
        "M⊥: part of the bending moment across the link, at its end; ℓ: from one end of the link to the other; "
        "φ: the turn of its end",
    ),
    "base_compliance": (
        r"\varphi = c\,M",
        "M: overturning moment about the foot of the first joint, its vertical part left out; φ: turn of the base",
    ),
    "backlash": (r"\Delta q = -\tfrac{1}{2}\, b\, s", "b: the whole width between the two sides; b > 0 stops short"),
    "hysteresis": (
        r"\Delta q = -h\, s\, \bigl(1 - e^{-d / d_0}\bigr)",
        "d: length of the last move; d₀: `travel`; h: half the width after long moves",
    ),
    "load_backlash": (r"\Delta q = -h\, s\, \lvert \tau \rvert", "τ: torque of gravity on the joint"),
    "joint_coupling": (r"\Delta q_B = c\, q_A", "A: the joint that is followed; B: the one that errs"),
    "payload_error": (
        r"\Delta q_j = e\, \tau_j(m)",
        "τⱼ: torque of the payload m alone on joint j; e: compliance times the relative error of the mass",
    ),
    "thermal_growth": (r"\Delta L = \alpha\, L\, (T - T_0)", "L: one length, or all; T₀ = 20 °C (ISO 1)"),
    "thermal_offset": (r"\Delta q = c\, (T - T_0)", "T₀ = 20 °C (ISO 1)"),
    "drift": (
        r"\Delta p = v\, \bigl(1 - e^{-t/\tau}\bigr) \quad \text{or} \quad \Delta p = v\, t / t_{\text{end}}",
        "v: shift at the end; t: since the first measurement",
    ),
    "slip": (r"\Delta q = h\, [t \ge t_0]", "t₀: when it slipped; of base or tool a shift and a turn instead of h"),
    "instrument_scale": (r"p \to (1 + c)\, p", "p: from the instrument, at the origin of the world"),
    "instrument_field": (
        r"\Delta p = \sum_{i \le j} w_{ij}\, p_i\, p_j",
        "wᵢⱼ: three numbers for each of six products",
    ),
    "quantisation": (
        r"\Delta q = c\, \bigl(\mathrm{round}(q / \delta)\, \delta - q\bigr)",
        "δ: `lsb`, the step of encoder or controller; c: about 1",
    ),
    "late_reading": (r"\Delta q = -t\, \dot q", "t: `delay`; of all joints, by their speed at the moment of the row"),
    "tool_shift": (r"\Delta p = R\, v\, [m > 0]", "R: orientation of the tool; m: payload of the row"),
    "joint_noise": (r"\Sigma_p \to \Sigma_p + \sigma^2 J_j J_j^{\mathsf{T}}", "Jⱼ = ∂p/∂qⱼ"),
    "range_noise": (r"\sigma = a + b\, r", "r: distance from the origin of the world, where the instrument is"),
    "stated_sigma": (r"\sigma \to k\, \sigma", "k: `factor`"),
    "outliers": (r"n \to (1 - s)\, n", "s: `share` of the rows that are worth nothing; n: rows"),
    "correlated_lengths": (
        r"\mathrm{cov}(L_A, L_B) = \rho\, \sigma_A\, \sigma_B",
        "ρ: of lengths that were made together",
    ),
}
SYMBOLS = """\
The program computes the pictures: solid where joint values were increasing on arrival, dashed where decreasing.

q: commanded value of the joint; Δq: what is added to it; s = +1 where its value was increasing on arrival, −1 where it
was decreasing; p: tool point, Δp: its shift; Σ: its covariance.
"""


def effects_page() -> str:
    """Every kind with its formula, its symbols, the data that show it, and where to look on the arm."""
    return SYMBOLS + "\n" + "\n".join(_entry(kind) for kind in CATALOGUE)


def _entry(kind: type[CatalogueEntry]) -> str:
    """One kind; a kind without a formula here is an error."""
    name = kind.kind_name()
    formula, symbols = FORMULAS[name]
    rows = [
        f"## `{name}`\n",
        f"{_sentence(kind.summary)}\n",
        f"$$\n{formula}\n$$\n",
        f"{symbols}.\n",
        f"![{name}](/generated/pictures/effect_{name}.png)\n",
    ]
    use, size = USES[name]
    facts = {
        "When to use": use,
        "Typical size": size,
        "Parameters": _parameters(kind),
        "Needs": _needs(kind),
        "Is shown by": _text(kind, "measurement"),
    }
    facts |= {"Is mistaken for": _rivals(kind), "Look at": _text(kind, "inspection")}
    return "\n".join([*rows, *(f"- **{head}**: {text}" for head, text in facts.items() if text), ""])


def _sentence(text: str) -> str:
    return f"{text[0].upper()}{text[1:].rstrip('.')}."


def _text(kind: type[CatalogueEntry], name: str) -> str:
    """A sentence of the class with its target named in general; nothing where instances make it up."""
    text = getattr(kind, name, "")
    return str(text).replace("{target}", "the joint").replace("{cycles}", "so many") if isinstance(text, str) else ""


def _parameters(kind: type[CatalogueEntry]) -> str:
    given = getattr(kind, "parameters", ())
    if not isinstance(given, tuple) or len(given) > 3:
        return ""
    return enumerated([f"`{name}` ({dimension})" for name, dimension in given])


def _needs(kind: type[CatalogueEntry]) -> str:
    return "; ".join(INPUTS[key].hint for key in sorted(kind.needs))


def _rivals(kind: type[CatalogueEntry]) -> str:
    given = getattr(kind, "rivals", {})
    pairs = given.items() if isinstance(given, dict) else ()
    return "; ".join(f"`{name}` ({text.replace('{target}', 'the joint')})" for name, text in pairs)
