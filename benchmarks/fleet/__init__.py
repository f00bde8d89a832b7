"""Posture selection on a fleet of arms and tasks, against a brute force that shares no code with the search."""
