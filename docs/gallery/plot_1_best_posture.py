"""
The best posture
================

The arm in the posture in which its tool point scatters least across the direction of insertion, with the 95 % ellipse
of the tool point. `solution.figures()` has all figures of a solution by name; `plot()` is the most important one.
"""

import posture_opt as po

problem = po.load_problem("insert_planar_2r")
solution = po.select_posture(problem)
figure = solution.plot()
