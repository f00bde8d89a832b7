"""
First order, exact, and a cloud
===============================

At a singular posture the first-order ellipse is flat, and false: the tool point moves on circles. The closed form
agrees with the Monte Carlo cloud of the full nonlinear model.
"""

import numpy as np

import posture_opt as po

problem = po.load_problem("lecture_folded_angles")
cloud = po.simulate(problem, np.radians([90, -180]), n=5000, seed=0)
figure = cloud.plot()
