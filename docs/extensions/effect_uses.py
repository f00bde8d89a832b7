"""When to state each effect in a problem file, and how large it typically is."""

from __future__ import annotations

USES = {  # kind -> when to state it, typical size
    "joint_scale": ("errors grow with the joint value: a gear ratio or an encoder scale is off", "1e-4 to 5e-4"),
    "gear_eccentricity": (
        "it repeats once per revolution: a gear or an encoder disc is off its axis",
        "0.1 to 0.3 mrad",
    ),
    "gear_second_harmonic": (
        "it repeats twice per revolution: a strain wave gear or an encoder is misaligned",
        "0.05 to 0.2 mrad",
    ),
    "gear_ripple": ("it repeats with the turns of the motor, and the gear ratio is known", "0.05 to 0.2 mrad"),
    "cyclic_error": ("it repeats at another rate, which a diagnosis has found", "0.05 to 0.3 mrad"),
    "joint_compliance": ("the arm deflects under its own weight or a payload", "0.25 to 20 µrad/(N m)"),
    "link_bending": ("links are long and slender, and the orientation of the tool matters too", "0.05 to 0.5 mrad"),
    "base_compliance": ("the arm is on a column, a vehicle or a thin plate", "0.02 to 0.2 mrad"),
    "backlash": ("a joint stops elsewhere when it comes from the other side", "0.05 to 0.3 mrad, 0.5 mrad worn"),
    "hysteresis": ("the same, and more after long moves: friction and wind-up", "0.1 to 0.8 mrad"),
    "load_backlash": ("the same, and more under load", "0.05 to 0.3 mrad"),
    "joint_coupling": ("one joint turns another, as in wrists whose shafts run in each other", "1e-4 to 1e-3"),
    "payload_error": ("the mass of the payload is not known well", "1 to 5 % of the deflection"),
    "thermal_growth": ("the task is done at another temperature than 20 °C", "11 to 13 µm/(m K) steel, 23 aluminium"),
    "thermal_offset": ("the zero of a joint moves as its motor warms up", "5 to 20 µrad/K"),
    "drift": ("measurements took long while arm or instrument warmed up", "0.05 to 0.2 mm"),
    "slip": ("something moved in the middle of a session", "any"),
    "instrument_scale": ("the instrument was checked against a scale bar", "1 to 10 µm/m"),
    "instrument_field": ("a diagnosis has found that the instrument errs over its volume", "some µm"),
    "quantisation": ("the encoder is coarse, or joint values in a log are rounded", "the step / √12"),
    "late_reading": ("a moving arm is read too late, or lags behind its commands", "0.1 to 1 ms"),
    "tool_shift": ("the loaded tool was measured on another nest", "0.1 to 0.5 mm"),
    "joint_noise": ("one joint repeats worse than the others", "0.05 to 0.3 mrad"),
    "range_noise": ("the instrument is less precise far away, as laser trackers are", "15 µm + 6 µm/m"),
    "stated_sigma": ("repeats scatter more, or less, than the stated σ", "0.5 to 3"),
    "outliers": ("some readings are expected to be lost or wrong", "0.01 to 0.05"),
    "correlated_lengths": ("lengths were machined in one setting, or a batch has shown it", "ρ of 0.3 to 0.9"),
}
