"""Distances and collisions by coal, the collision library of Pinocchio, with its tolerances near rounding."""

from __future__ import annotations

import coal
import numpy as np
import pinocchio

REQUEST = coal.DistanceRequest()
REQUEST.gjk_tolerance = REQUEST.epa_tolerance = 1e-12
REQUEST.gjk_max_iterations = 2000
REQUEST.gjk_variant = coal.GJKVariant.PolyakAcceleration  # plain GJK stalls at this tolerance
REQUEST.gjk_convergence_criterion = coal.GJKConvergenceCriterion.DualityGap
REQUEST.gjk_convergence_criterion_type = coal.GJKConvergenceCriterionType.Absolute


def capsule(start, end, radius):
    """A capsule, or a sphere, and its pose."""
    along = end - start
    length = float(np.linalg.norm(along))
    if length == 0:
        return coal.Sphere(radius), coal.Transform3s(np.eye(3), start)
    rotation = pinocchio.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), along / length).toRotationMatrix()
    return coal.Capsule(radius, length), coal.Transform3s(rotation, (start + end) / 2)


def solid(obstacle):
    """An obstacle of a problem file and its pose."""
    if obstacle.kind == "sphere":
        return coal.Sphere(obstacle.radius), coal.Transform3s(np.eye(3), np.array(obstacle.xyz))
    if obstacle.kind == "half_space":
        normal = np.array(obstacle.normal)
        return coal.Halfspace(normal / np.linalg.norm(normal), obstacle.offset), coal.Transform3s.Identity()
    shape = coal.Box(*obstacle.size) if obstacle.kind == "box" else coal.Cylinder(obstacle.radius, obstacle.length)
    return shape, coal.Transform3s(pinocchio.rpy.rpyToMatrix(*obstacle.rpy), np.array(obstacle.xyz))


def distance(one, other):
    """The distance of two solids with their poses [m]; below zero where they overlap."""
    return coal.distance(*one, *other, REQUEST, coal.DistanceResult())
