"""Who makes an arm, as far as its name says so: a program for another maker's controller is noticed."""

from __future__ import annotations

import re

MAKERS = {
    "Universal Robots": r"universal robots|(?<![a-z])ur ?\d+e?(?![a-z0-9])",
    "KUKA": r"kuka|iiwa|(?<![a-z])(kr|lbr) ?\d",
    "ABB": r"(?<![a-z])abb(?![a-z])|(?<![a-z])(irb|crb) ?\d|gofa|yumi",
    "FANUC": r"fanuc|lr ?mate|(?<![a-z])crx",
    "Yaskawa": r"yaskawa|motoman|(?<![a-z])gp\d",
    "Stäubli": r"st(ä|ae|a)ubli|(?<![a-z])(tx2?|rx) ?-?\d",
    "Franka Emika": r"franka|panda|(?<![a-z])fr3",
    "Kinova": r"kinova|(?<![a-z])(gen3|jaco|j2[ns])",
    "UFACTORY": r"ufactory|xarm",
    "Doosan": r"doosan",
    "DENSO": r"denso",
    "Epson": r"epson",
    "Unitree": r"unitree|(?<![a-z])z1",
    "Unimation": r"unimation|puma",
}
"""Maker -> what names of its arms hold, in lower case, blanks for other characters than letters and digits."""


def maker_of(name: str) -> str:
    """The maker of an arm of this name; empty where the name does not say.

    Example:
        >>> maker_of("Universal Robots UR10 (CB3)"), maker_of("ur10_robot"), maker_of("my arm")
        ('Universal Robots', 'Universal Robots', '')
    """
    plain = re.sub(r"[\W_]+", " ", name.lower())
    return next((maker for maker, pattern in MAKERS.items() if re.search(pattern, plain)), "")
