"""Which link of a URDF carries the tool, where the file leaves it open."""

from __future__ import annotations

from posture_opt.errors import InputError, Issue, listed
from posture_opt.robot.urdf_tree import UrdfJoint, UrdfTree

FLANGE = "tool0"
"""ROS-Industrial's name of the tool flange."""
_MAX_LISTED_LINKS = 12
"""Links that a message lists; hands have more leaves than a reader compares."""


def chosen_tip(tree: UrdfTree, base: str) -> str:
    """The only last link behind ``base``, or ``tool0`` among several.

    Raises:
        InputError: several last links, all of them listed with their joints, and the link that carries fingers.
    """
    leaves = tree.leaves(base)
    if len(leaves) == 1 or FLANGE in leaves:
        return leaves[0] if len(leaves) == 1 else FLANGE
    message = f"the URDF has {len(leaves)} last links behind '{base}'"
    raise InputError(
        Issue(
            message, ("tip_link",), None, f"name one: tip_link: {listed(_tip_options(tree, base), _MAX_LISTED_LINKS)}"
        )
    )


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
