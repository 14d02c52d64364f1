"""The state of a beam at one instant."""

from __future__ import annotations

from dataclasses import dataclass

from ancf_casadi.mechanics.nodes import NODE
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import array, number
from ancf_casadi.support.tables import Displayed, plural


@dataclass(frozen=True, eq=False)
class State(Displayed):
    """Coordinates and velocities of a beam at one instant, from which a simulation can start.

    Parameters
    ----------
    coordinates : array (4 n + 4,)
        Nodal coordinates in the laboratory frame, from the clamped node on: positions, m, and dimensionless slopes.
    velocities : array (4 n + 4,)
        Rates of the coordinates, m/s and 1/s.
    time : float
        Time on the clock of the base motion and the load, s.
    internal : array, optional
        Internal strains of a law that relaxes: element by element and, in each element, branch by branch.  A run hands
        them from one time segment to the next.  If not given, the beam is relaxed in its shape.

    Raises
    ------
    InputError
        If a value is not a number.

    Examples
    --------
    Continue a run from its last sample:

    >>> from ancf_casadi import Beam, HarmonicBase, Model, simulate
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=4)
    >>> model, base = Model(beam), HarmonicBase(amplitude=5e-3, frequency=2.0)
    >>> first = simulate(model, base=base, duration=0.1)
    >>> second = simulate(model, base=base, duration=0.1, start=first.state(-1))
    >>> second.time[[0, -1]].round(3)
    array([0.1, 0.2])
    """

    coordinates: Array
    velocities: Array
    time: float = 0.0
    internal: Array | None = None

    def __post_init__(self) -> None:
        """Validate, and keep arrays."""
        for name in ("coordinates", "velocities"):
            object.__setattr__(self, name, array(getattr(self, name), name, finite=False))
        object.__setattr__(self, "time", number(self.time, "time"))

    def _summary(self) -> str:
        return f"{self.time:.6g} s, {plural(len(self.coordinates) // NODE, 'node')}"
