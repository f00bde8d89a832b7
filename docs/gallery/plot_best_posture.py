"""
The best posture
================

The arm in the posture in which its tool point scatters least across the direction of insertion.
"""

import posture_opt as po

solution = po.select_posture(po.load_problem("../../problems/insert_planar_2r.yaml"))
figure = solution.plot()
