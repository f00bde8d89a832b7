"""
Four holes, one placement
=========================

The scatter of the worst of four holes over the placement of the plate. The best placement is marked.
"""

import posture_opt as po

problem = po.load_problem("insert_ur10_plate")
solution = po.select_posture(problem)
figures = solution.figures()
bench = figures["bench"]
