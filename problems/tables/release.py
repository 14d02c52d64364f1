"""The table [release]: the load at the tip that holds the beam until it is released."""

from __future__ import annotations

from typing import Any

from ancf_casadi.mechanics.model import Model
from ancf_casadi.support.inputs import located
from ancf_casadi.vibration.equilibrium import Equilibrium, static_equilibrium
from problems.tables.study import checked

KEYS = """\
  [release]     the load that holds the beam until time 0: tip_force (N),
                tip_moment (N m)
"""


def read_release(table: Any, model: Model, where: str) -> Equilibrium:
    """Return the equilibrium under the load of a table.

    Raises
    ------
    InputError
        If a key or value cannot be used.
    EquilibriumError
        If there is no equilibrium under this load.
    """
    given = checked(table, set(), {"tip_force", "tip_moment"}, where)
    with located(where):
        return static_equilibrium(model, **given)
