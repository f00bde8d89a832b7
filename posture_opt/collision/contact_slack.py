"""``ContactSlack``: by how much postures exceed the distances that are to be kept, in one call of C."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from posture_opt.collision.contacts import Contacts
from posture_opt.collision.contacts_c import C_TEXT
from posture_opt.model.row_loop import RowLoop
from posture_opt.numerics import Array

_LOOP = (
    C_TEXT
    + """
long long posture_opt_loop(long long rows, long long n, const double* q, double* slack, long long capsules,
    long long pairs, const double* turns, const double* moved, const double* radii, const double* pair,
    const double* solid, double reach) {
  po_scene scene = {n, capsules, pairs, turns, moved, radii, pair, solid, reach};
  const long long failed = po_scene_open(&scene) ? 0 : -1;
  long long row, count;
  po_contact nearest;
  for (row = 0; row < rows && !failed; ++row) {
    po_place(&scene, q + row * n);
    count = po_contacts(&scene, 1, &nearest);
    slack[row] = count ? nearest.distance - nearest.least : reach;
  }
  po_scene_close(&scene);
  return failed;
}
"""
)


@dataclass(frozen=True)
class ContactSlack:
    """The least of distance less what is to be kept [m], at most the reach of the contacts.

    Args:
        contacts: what is kept apart.
        compiled: None or True; there is no other way of evaluating it.
    """

    contacts: Contacts
    compiled: bool | None

    @cached_property
    def _loop(self) -> RowLoop:
        """All postures in one call."""
        return RowLoop({"frames": self.contacts.frames}, _LOOP, self.compiled)

    @property
    def active(self) -> bool:
        """Whether anything is kept apart."""
        return bool(self.contacts.pairs)

    def slack(self, Q: Array) -> Array:
        """(N,) at the postures Q (N, n) [m]."""
        Q, slack = np.ascontiguousarray(Q), np.zeros(len(Q))
        self._loop(len(Q), Q.shape[1], Q, slack, *self.contacts.arguments)
        return slack
