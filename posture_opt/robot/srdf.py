"""What an SRDF says of an arm: links that need not be checked against each other, and named postures.

Source: MoveIt, "URDF and SRDF": elements disable_collisions and group_state.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from posture_opt.errors import InputError, Issue
from posture_opt.files import content, located
from posture_opt.robot.urdf_reader import MAX_BYTES, MAX_NUMBER, Element, read_elements
from posture_opt.robot.urdf_tree import UrdfTree
from posture_opt.texts import text_fault

_FREE_JOINTS = ("floating", "planar")
"""Types of joints with several values, as of a base that drives: never in a chain."""


@dataclass(frozen=True)
class Srdf:
    """The parts of an SRDF that count here.

    Args:
        disabled: pairs of links whose collisions are not checked.
        states: name -> joint -> value [rad or m].
    """

    disabled: frozenset[frozenset[str]]
    states: dict[str, dict[str, float]]

    def allowed_pairs(self, carried: dict[str, list[str]]) -> frozenset[frozenset[str]]:
        """Pairs of joints of which no link is checked against a link of the other.

        Args:
            carried: joint, or ``base`` -> the links with a shape that are fixed to what it moves.
        """
        names = list(carried)
        return frozenset(
            frozenset((a, b))
            for k, a in enumerate(names)
            for b in names[:k]
            if carried[a]
            and carried[b]
            and all(frozenset((one, other)) in self.disabled for one in carried[a] for other in carried[b])
        )

    def postures(self, joints: tuple[str, ...]) -> tuple[tuple[str, tuple[tuple[str, float], ...]], ...]:
        """The named postures of some joints; states of other joints alone, of a gripper say, are left out."""
        found = (
            (name, tuple((joint, values[joint]) for joint in joints if joint in values))
            for name, values in self.states.items()
        )
        return tuple((name, values) for name, values in found if values)


def read_srdf(folder: Path, file: str, tree: UrdfTree) -> Srdf:
    """The SRDF in ``file``, named from ``folder``, of the robot of a URDF.

    Raises:
        InputError: no such file, no SRDF, values that are no numbers, or one of another robot; under the key ``srdf``.
    """
    try:
        path = located(folder, file)
        root = read_elements(content(path, MAX_BYTES))[0]
        if root.tag != "robot":
            raise InputError(Issue(f"the file is no SRDF: it begins with <{root.tag}>, not <robot>", line=root.line))
        disabled = frozenset(_pairs(root))
        named = {link for pair in disabled for link in pair}
        if named and not named & {*tree.links}:
            raise InputError(Issue("none of its links is in the URDF", hint="is it that of another robot?"))
        return Srdf(disabled, _states(root, {joint.name for joint in tree.joints if joint.type not in _FREE_JOINTS}))
    except InputError as error:
        raise InputError([_in_srdf(issue, file) for issue in error.issues]) from None


def _in_srdf(issue: Issue, file: str) -> Issue:
    """The issue about a line of the SRDF as one about the key ``srdf``."""
    line = f"line {issue.line}: " if issue.line else ""
    return Issue(f"{line}{issue.message}", ("srdf",), file, issue.hint)


def _pairs(root: Element) -> Iterator[frozenset[str]]:
    """The pairs of links of ``<disable_collisions>``."""
    for element in root.each("disable_collisions"):
        pair = frozenset(_text(element, key) for key in ("link1", "link2"))
        if len(pair) == 2:
            yield pair


def _states(root: Element, single: set[str]) -> dict[str, dict[str, float]]:
    """The named states; of several of one name, in several groups, the one with most joints.

    Values of joints with several degrees of freedom, which are none of the ``single`` ones, are left out.

    Raises:
        InputError: a value that is no number, or a state of a group, or a joint of a state, that is stated twice.
    """
    found: dict[str, dict[str, float]] = {}
    stated: set[tuple[str, str]] = set()
    for state in root.each("group_state"):
        name, group = _text(state, "name"), _text(state, "group")
        if (name, group) in stated:
            raise InputError(Issue(f"the state '{name}' of the group '{group}' is stated twice", line=state.line))
        stated.add((name, group))
        values: dict[str, float] = {}
        for joint in state.each("joint"):
            moved = _text(joint, "name")
            if moved in values:
                raise InputError(Issue(f"the state '{name}' states the joint '{moved}' twice", line=joint.line))
            if moved in single or len(_text(joint, "value").split()) < 2:
                values[moved] = _value(joint)
        if len(values) > len(found.get(name, {})):
            found[name] = values
    return found


def _value(joint: Element) -> float:
    """The value [rad or m] of a joint in a state."""
    text = _text(joint, "value")
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(Issue(f"the value '{text}' of a joint is no number", line=joint.line))
    if abs(value) > MAX_NUMBER:
        raise InputError(Issue(f"the value '{text}' of a joint is not plausible", line=joint.line))
    return value


def _text(element: Element, key: str) -> str:
    """An attribute; empty where it is missing.

    Raises:
        InputError: it holds a line break, or what else no text may hold.
    """
    given = element.attributes.get(key, "")
    fault = text_fault(given)
    if fault is not None:
        raise InputError(Issue(f"<{element.tag} {key}=…>: {fault[0]}", hint=fault[1], line=element.line))
    return given
