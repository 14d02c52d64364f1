"""Viscoelastic damping: a material that relaxes.

Maxwell branches act in axial strain and curvature, in parallel with the elastic beam of the relaxed modulus E.  A
branch is a spring of modulus g_b E in series with a dashpot.  With the strain s at a Gauss point, the internal strain
z_b, that of the dashpot, and the overstrain y_b, that of the spring,

    tau_b dz_b/dt = y_b,    y_b = s - z_b,    stress = E (s + sum_b g_b y_b).

With the strain energy U = 1/2 sum_i d_i s_i^2 of the element, J = ds/de and D = diag(d_i), the force is

    Q = J^T D sum_b g_b y_b.

Like the elastic force, it is objective.  Under a constant strain, the modulus falls from the instantaneous one,
E (1 + sum_b g_b), to E.  In a vibration s exp(i omega t), it is complex,

    E (1 + sum_b g_b i omega tau_b/(1 + i omega tau_b)).

References
----------
N. W. Tschoegl, The Phenomenological Theory of Linear Viscoelastic Behavior, Springer (1989), Section 3.4.
J. C. Simo, T. J. R. Hughes, Computational Inelasticity, Springer (1998), Section 10.2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np

from ancf_casadi.damping.law import DampingLaw, Forces, Parameter, S, check_values
from ancf_casadi.exceptions import InputError
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import check_instance, is_sequence, physical, shown
from ancf_casadi.vibration.modes import Modes


@final
@dataclass(frozen=True)
class ViscoelasticDamping(DampingLaw):
    """A material that relaxes: Maxwell branches in axial strain and curvature.

    The elastic modulus of the beam is the relaxed one.  At the start of a motion, the beam is relaxed in its initial
    shape.  Simulated motion, its derivatives and fits, ``damped_modes`` and ``linear_frf`` accept this law; elsewhere
    it is refused.  Statics and natural modes are those of the relaxed beam.

    Parameters
    ----------
    ratios : sequence of float
        Modulus of each branch relative to that of the beam.
    times : sequence of float
        Relaxation time of each branch, s.

    Raises
    ------
    InputError
        If a value is not positive, or there is not one time for each ratio.

    Examples
    --------
    >>> from ancf_casadi import Beam, Model, ViscoelasticDamping, natural_modes
    >>> beam = Beam.uniform(length=0.1, width=0.03, thickness=0.03,
    ...                     density=1070.0, elastic_modulus=240e3, elements=4)
    >>> modes = natural_modes(Model(beam), count=2)
    >>> ViscoelasticDamping(ratios=[0.02], times=[0.03]).damping_ratios(modes, [0.0, 0.0]).round(4)
    array([0.0044, 0.0014])
    """

    ratios: Sequence[float]
    times: Sequence[float]

    def __post_init__(self) -> None:
        """Validate, and keep the numbers as tuples."""
        for name in ("ratios", "times"):
            values = getattr(self, name)
            if not is_sequence(values):
                raise InputError(f"must have one value per branch, got {shown(values)}", name)
            object.__setattr__(self, name, tuple(physical(value, name) for value in values))
        if len(self.ratios) != len(self.times):
            raise InputError(f"has {len(self.times)} values for {len(self.ratios)} ratios", "times")

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The relative moduli, then the relaxation times."""
        pairs = list(enumerate(zip(self.ratios, self.times, strict=True), start=1))
        least = 1e-6  # usual lower bound of the estimates, which must be positive; 1 or s
        moduli = [Parameter(f"modulus{k}", g, "1", f"relative modulus of branch {k}", least) for k, (g, _) in pairs]
        times = [Parameter(f"time{k}", tau, "s", f"relaxation time of branch {k}", least) for k, (_, tau) in pairs]
        return (*moduli, *times)

    def with_parameters(self, values: Sequence[float] | Array) -> ViscoelasticDamping:
        """Return the law with other relative moduli and relaxation times."""
        checked, count = check_values(self, values), len(self.ratios)
        return ViscoelasticDamping(checked[:count], checked[count:])

    def local_force(self, body: Forces, e: S, e_t: S, properties: S, parameters: S) -> S:
        """Return zero: the force depends on the history of the motion."""
        return 0 * e_t

    def branches(self, parameters: S) -> tuple[S, S]:
        """Return relative moduli and relaxation times."""
        count = len(self.ratios)
        return parameters[:count], parameters[count:]

    def damping_ratios(self, modes: Modes, amplitudes: Sequence[float] | Array) -> Array:
        """Return half the loss factor of small vibration in each mode, at any amplitude.

        The energies lost per period and stored are those at the frequency and in the mode shape of the relaxed beam,
        which is accurate for small relative moduli.
        """
        check_instance(modes, "modes", Modes)
        model, shapes, omega = modes.model, modes.shapes, modes.angular_frequencies
        forces = model.strain_rate_force(modes.equilibrium.coordinates, shapes, model.properties).full()
        return np.asarray(self.relaxation(1j * omega).imag * (shapes * forces).sum(axis=0) / (2 * omega**2))
