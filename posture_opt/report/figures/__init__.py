"""The figures: each function returns a matplotlib ``Figure`` that belongs to no window."""
