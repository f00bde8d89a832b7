"""
Before and after a calibration
==============================

The errors of the rows that the fit has not seen, and whether the predicted spread is true.
"""

import posture_opt as po

problem = po.load_problem("insert_planar_2r_measured")
data = po.read_measurements("../../problems/planar_2r_measured.csv", problem)
calibration = po.calibrate(problem, data)
assessment = po.assess(calibration)
figure = assessment.plot()

# %%
# Predicted ellipses and measured points
check = po.check_spread(calibration)
coverage = check.plot()
