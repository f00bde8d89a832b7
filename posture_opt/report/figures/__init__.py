"""The figures: each function returns a matplotlib ``Figure`` that belongs to no window."""

from __future__ import annotations

from posture_opt.report.figures.arm import plot_solution, plot_spread
from posture_opt.report.figures.cloud import plot_cloud, plot_cross_section
from posture_opt.report.figures.solution import plot_budget, plot_joint_map

__all__ = ["plot_budget", "plot_cloud", "plot_cross_section", "plot_joint_map", "plot_solution", "plot_spread"]
