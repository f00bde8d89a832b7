"""posture_opt."""
