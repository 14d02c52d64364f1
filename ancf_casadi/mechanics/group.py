"""Equal elements and their places in the beam: which coordinates and properties of the beam each of them has.

Both assemblies use the groups: the symbolic one (``model``) and the numerical one (``vibration.assembly``).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import casadi as cs
import numpy as np

from ancf_casadi.mechanics.element import Element
from ancf_casadi.support.arrays import Index


@dataclass(frozen=True, eq=False)
class Group:
    """Elements of one kind, side by side.

    The properties of an element are a column of P if the group has columns, then ``constants``, then ``lumped``.

    Parameters
    ----------
    element : Element
        The Functions of one of them.
    coordinates : array (k, d)
        Indices of the nodal coordinates of each of the k elements.
    columns : int
        Number of columns of P, from the first, that belong to these elements: k, or 0.
    constants : tuple of float
        The fixed properties: length and axis.
    lumped : mapping of str to float
        Names, from ``beam.LUMPED``, and values of the properties that the beam has only once.
    """

    element: Element
    coordinates: Index
    columns: int
    constants: tuple[float, ...]
    lumped: dict[str, float]

    @property
    def count(self) -> int:
        """Number k of elements."""
        return len(self.coordinates)

    def properties(self, P: Any, lumped: Mapping[str, Any] | None = None) -> Any:
        """Return the properties of each element as columns.

        They come from the properties P (4, n) of the beam and, if given, other values of the lumped ones by name.
        """
        own = self.lumped if lumped is None else {name: lumped[name] for name in self.lumped}
        given = cs.vertcat(*self.constants, *own.values())
        return cs.vertcat(P[:, : self.columns], cs.repmat(given, 1, self.columns)) if self.columns else given

    def gather(self, e: cs.MX) -> cs.MX:
        """Return the coordinates of each element as columns, (d, k s), from s states of all nodes, (size, s)."""
        columns = np.arange(e.size2())[:, None] * e.size1()
        places = (self.coordinates.ravel() + columns).ravel()
        return cs.reshape(e.nz[places.tolist()], self.coordinates.shape[1], -1)

    def scatter(self, forces: cs.MX, size: int) -> cs.MX:
        """Return the sums at all nodes, (size, s), of element forces, (d, k s)."""
        rows = self.coordinates.ravel()
        pattern = cs.Sparsity.triplet(size, rows.size, rows.tolist(), list(range(rows.size)))
        return cs.DM(pattern, 1.0) @ cs.reshape(forces, rows.size, -1)
