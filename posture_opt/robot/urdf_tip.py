"""Which link of a URDF carries the tool, where the file leaves it open."""

from __future__ import annotations

import re
from dataclasses import dataclass

from posture_opt.errors import InputError, Issue, listed
from posture_opt.robot.urdf_fingers import Fingers
from posture_opt.robot.urdf_tree import UrdfJoint, UrdfTree

FLANGE = "tool0"
"""ROS-Industrial's name of the tool flange."""
_TOOL_NAME = re.compile(r"(^|_)(tool|tcp|eef?|end_effector|flange)(_link|_frame)?$", re.IGNORECASE)
_MAX_LISTED_LINKS = 12
"""Links that a message lists; hands have more leaves than a reader compares."""


@dataclass(frozen=True)
class ChosenTip:
    """The end of a chain that the file leaves open.

    Args:
        link: the last link of the chain.
        fingers: joints that move fingers of a gripper behind it and are no part of the chain, each with the reason.
        others: further links that the chain could end at.
    """

    link: str
    fingers: tuple[tuple[str, str], ...] = ()
    others: tuple[str, ...] = ()

    def notes(self) -> tuple[str, ...]:
        """What was assumed, where anything was."""
        if not self.fingers:
            return ()
        joints = listed([f"{joint} ({why})" for joint, why in self.fingers])
        moved = "is taken for a finger" if len(self.fingers) == 1 else "are taken for fingers"
        return (f"the chain ends at {self.link}: {joints} {moved} of a gripper; tip_link names another end",)


def chosen_tip(tree: UrdfTree, base: str) -> ChosenTip:
    """The last link behind ``base`` that carries no finger: the only one, else ``tool0``, else the only one that is
    named after a tool.

    Raises:
        InputError: several such links, all of them listed with their joints, and the link that carries fingers.
    """
    fingers = Fingers(tree, base)
    named = tuple((joint.name, fingers.reasons[joint.name]) for joint in fingers.first())
    leaves = fingers.leaves()
    moved = [leaf for leaf in leaves if _moves(tree, base, leaf)] or leaves
    tools = [leaf for leaf in moved if _TOOL_NAME.search(leaf)]
    for options in (leaves, [leaf for leaf in leaves if leaf == FLANGE], moved, tools):
        if len(options) == 1:
            link = options[0]
            ends = dict.fromkeys((*moved, *tree.leaves(base)))
            return ChosenTip(link, named, tuple(leaf for leaf in ends if leaf != link and _moves(tree, base, leaf)))
    message = f"the URDF has {len(moved)} last links behind '{base}'"
    named_links = listed(_tip_options(tree, base), _MAX_LISTED_LINKS)
    raise InputError(Issue(message, ("tip_link",), None, f"name one: tip_link: {named_links}"))


def _moves(tree: UrdfTree, base: str, link: str) -> bool:
    """Whether a joint moves between ``base`` and ``link``."""
    return any(joint.type != "fixed" for joint in tree.path(base, link))


def _tip_options(tree: UrdfTree, base: str) -> list[str]:
    """The links that may be meant, each with its chain in words: tool frames, then what carries fingers, then these."""
    paths = {leaf: tree.path(base, leaf) for leaf in tree.leaves(base)}
    fixed = [leaf for leaf, path in paths.items() if path and path[-1].type == "fixed"]
    moving = [leaf for leaf in paths if leaf not in fixed]
    carriers = dict.fromkeys(_carrier_link(paths[leaf], base) for leaf in moving)
    between = [link for link in carriers if link != base and link not in paths]
    words = {leaf: _chain_words(path) for leaf, path in paths.items()}
    words |= {
        link: f"{_chain_words(tree.path(base, link))}, carries {_finger_links(paths, link, moving, base)}"
        for link in between
    }
    return [f"{link} ({words[link]})" for link in (*fixed, *between, *moving)]


def _carrier_link(path: list[UrdfJoint], base: str) -> str:
    """The parent link of the last moving joint of a path; ``base`` where none moves."""
    return next((joint.parent for joint in reversed(path) if joint.type != "fixed"), base)


def _finger_links(paths: dict[str, list[UrdfJoint]], link: str, moving: list[str], base: str) -> str:
    """The last links that a link carries by one moving joint, as one text."""
    return ", ".join(leaf for leaf in moving if _carrier_link(paths[leaf], base) == link)


def _chain_words(path: list[UrdfJoint]) -> str:
    """How many joints move on a path, and that it is not possible where one of them mimics another."""
    turning = [joint for joint in path if joint.type != "fixed"]
    mimics = [joint.name for joint in turning if joint.mimics]
    count = f"{len(turning)} {'joint' if len(turning) == 1 else 'joints'}"
    return f"{count}, not possible: {mimics[0]} mimics another" if mimics else count
