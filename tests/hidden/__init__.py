"""Arms with hidden effects: a simulator that knows nothing of the package, and the harness that scores the answers."""
