"""Which measurement tells two causes apart that these data cannot."""

from __future__ import annotations

Cause = tuple[str, str]

_GEARS = ("gear_eccentricity", "gear_second_harmonic", "joint_scale")
_SHARED: dict[tuple[str, str], str] = {
    ("joint_scale", "gear_eccentricity"): "drive {a} through its whole range: a scale grows on, an eccentricity "
    "comes back",
    ("joint_scale", "gear_second_harmonic"): "drive {a} through its whole range: a scale grows on, a wave comes back",
    ("gear_eccentricity", "gear_second_harmonic"): "drive {a} through a whole turn: on part of it one wave looks like "
    "two",
    ("joint_compliance", "gear_eccentricity"): "measure the same postures under two payloads: a joint that gives way "
    "does so in proportion, a gear does not feel the load",
    ("joint_compliance", "gear_second_harmonic"): "measure the same postures under two payloads: a gear does not feel "
    "the load",
    ("joint_compliance", "link_bending"): "measure the orientation of the tool too, under two payloads: a bent link "
    "turns its end by another share than a joint does",
    ("joint_compliance", "base_compliance"): "measure targets fixed to the base in every posture: a base that yields "
    "moves them",
    ("link_bending", "base_compliance"): "measure targets fixed to the base in every posture",
    ("joint_compliance", "payload_error"): "measure under three payloads, one of them none, each weighed: the weight "
    "of the links pulls with no payload too",
    ("link_bending", "payload_error"): "measure under three payloads, one of them none, each weighed",
    ("base_compliance", "payload_error"): "measure under three payloads, one of them none, each weighed",
    ("backlash", "hysteresis"): "arrive from both sides after short moves and after long ones: play is the same, "
    "hysteresis grows with the move",
    ("backlash", "load_backlash"): "arrive from both sides under two payloads",
    ("hysteresis", "load_backlash"): "arrive from both sides, after short and long moves, under two payloads",
    ("joint_coupling", "joint_scale"): "move both joints of the coupling over wide ranges, each by itself",
    ("thermal_growth", "drift"): "let the arm warm up and cool down again while the temperature is logged: time and "
    "temperature then part",
    ("thermal_offset", "drift"): "let the arm warm up and cool down again while the temperature is logged",
    ("thermal_growth", "thermal_offset"): "measure stretched and folded postures at the same temperatures: growth "
    "acts along the links, a wandering zero across them",
    ("drift", "slip"): "come back to the same few postures again and again: a drift creeps, a slip jumps",
    ("drift", "instrument_field"): "visit the postures again in another order, so that place and time part",
    ("cyclic_error", "gear_ripple"): "measure many joint values that lie on no grid, and state 'gear_ratio'",
    ("cyclic_error", "quantisation"): "log the joint values that the controller reached, and measure many off any grid",
    ("gear_ripple", "quantisation"): "log the joint values that the controller reached, and state 'gear_ratio'",
    ("joint_noise", "range_noise"): "repeat postures near the instrument and far from it, moving away between",
    ("joint_noise", "outliers"): "repeat each posture a few times, moving away between: an outlier does not come back",
    ("range_noise", "stated_sigma"): "repeat postures near the instrument and far from it",
}
_PAIRS = {frozenset(pair): text for pair, text in _SHARED.items()}
_ALONE = {
    "joint_scale": "drive {a} through its whole range",
    "gear_eccentricity": "drive {a} through a whole turn, under two payloads",
    "gear_second_harmonic": "drive {a} through a whole turn",
    "gear_ripple": "measure many joint values that lie on no grid",
    "cyclic_error": "measure many values of {a} that lie on no grid, in postures that differ in all other joints",
    "joint_compliance": "measure the same postures under two payloads",
    "link_bending": "measure the orientation of the tool too, under two payloads",
    "base_compliance": "measure targets fixed to the base in every posture",
    "backlash": "arrive at each posture from both sides, in random order",
    "hysteresis": "arrive from both sides after short moves and after long ones",
    "load_backlash": "arrive from both sides under two payloads",
    "joint_coupling": "move both joints of the coupling over wide ranges, each by itself",
    "payload_error": "measure under three payloads, one of them none",
    "thermal_growth": "log the temperature through warming up and cooling down",
    "thermal_offset": "log the temperature through warming up and cooling down",
    "drift": "come back to a reference target every few postures, and take the others in random order",
    "slip": "come back to the same few postures again and again",
    "instrument_field": "measure the same postures from a second station of the instrument",
    "quantisation": "log the joint values that the controller reached",
    "joint_noise": "repeat each posture a few times, moving away between",
    "range_noise": "repeat postures near the instrument and far from it",
}
_PLAN = "measure postures that differ in what each of them hangs on"


def splitting_measurement(cause: Cause, rival: Cause) -> str:
    """What to measure so that one of two causes goes."""
    (kind, target), (other_kind, other_target) = cause, rival
    if kind == other_kind and target != other_target and kind not in ("thermal_growth", "drift"):
        return (
            f"move {target.split('->')[-1]} while {other_target.split('->')[-1]} stands still, and the other way round"
        )
    text = _PAIRS.get(frozenset((kind, other_kind)))
    if text is None and "instrument_field" in (kind, other_kind):
        text = _ALONE["instrument_field"]
    if text is None:
        both = [_ALONE[k].format(a=t) for k, t in (cause, rival) if k in _ALONE]
        return "; ".join(dict.fromkeys(both)) or _PLAN
    return text.format(a=target if kind in _GEARS else other_target)
