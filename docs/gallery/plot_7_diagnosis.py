"""
Why an arm misses
=================

The errors of each joint over what causes them, with the curves of the effects that were found. Hidden in these
simulated data are a compliant elbow and a first gear with play.
"""

import posture_opt as po

problem = po.load_problem("insert_ur10_measured")
data = po.read_measurements("../../problems/ur10_measured.csv", problem)
diagnosis = po.diagnose(problem, data)
print(diagnosis)

# %%
# Each effect with the measured errors behind it
curves = diagnosis.plot()

# %%
# The errors of the three models on one scale
figures = diagnosis.figures()
errors = figures.get("errors")
