"""`python -m benchmarks.results`: every measurement of this folder that has a number, in one run, as RESULTS.md.

A part is a module with ``measure(quick)``, which yields sections. Every part runs in a process of its own, so that one
that crashes or takes too long becomes a line with its reason.
"""

PARTS = ("peers", "covariance", "c", "targets", "joints", "cells", "sources", "rows", "workers", "start", "limits")
