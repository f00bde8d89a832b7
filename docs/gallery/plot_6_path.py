"""
Along a path
============

The scatter across the travel along a bead, with its sources.
"""

import posture_opt as po

problem = po.load_problem("dispense_planar_2r")
solution = po.select_posture(problem)
figure = solution.plot()
