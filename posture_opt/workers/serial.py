"""``Serial``: one part after the other, in this process."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from posture_opt.workers.workers import Part, R, S, T, Workers, worked


class Serial(Workers):
    """Works on one part after the other, in this process.

    Example:
        >>> with Serial() as workers:
        ...     workers.in_order(pow, 2, [1, 2, 3])
        [2, 4, 8]
    """

    def run(self, part: Part[S, T, R], shared: S, items: Sequence[T]) -> Iterator[tuple[int, R]]:
        """As of `Workers`, in the order of the items."""
        for k, item in enumerate(items):
            yield k, worked(part, shared, item)
