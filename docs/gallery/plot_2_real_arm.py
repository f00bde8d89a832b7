"""
A real arm, its budget and its rivals
=====================================

A Panda inserts from above. Which error counts most, and how much worse are other postures?
"""

import posture_opt as po

problem = po.load_problem("insert_panda")
solution = po.select_posture(problem)
figures = solution.figures()
print(*figures)

# %%
# The arm
arm = solution.plot()

# %%
# Each source's share in the variance that counts
budget = figures.get("budget")
