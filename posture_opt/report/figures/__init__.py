"""The figures: each function returns a matplotlib ``Figure`` that belongs to no window.

Axes carry units; colours are the same in all figures (``page.style``) and never the only difference between two lines.
"""
