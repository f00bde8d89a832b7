"""
Where the part should stand
===========================

The task solved at every target of a grid. Hatched targets have no posture.
"""

import posture_opt as po

problem = po.load_problem("insert_panda")
places = po.map_targets(problem, counts=(9, 9))
figure = places.plot()
