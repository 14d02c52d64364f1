"""
A large swing under added laws
==============================

A large swing under the sum of three damping laws: modal, quadratic, and a little strain-rate damping.

The hanging strip is released from a static tip force and swings 0.3 L to either side.  The energy lost to damping
equals the decrease of kinetic, strain and potential energy, so the energy balance closes.  The strain-rate damping, a
ratio of 1e-5 in mode 1, damps the high modes of the mesh, which would otherwise keep ringing and shorten the steps.
"""

import numpy as np

from ancf_casadi import (
    Beam,
    ModalDamping,
    Model,
    QuadraticDamping,
    RayleighDamping,
    natural_modes,
    simulate,
    static_equilibrium,
)

model = Model(
    Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3, density=8000.0, elastic_modulus=210e9, elements=10)
)
law = (
    ModalDamping(natural_modes(model, count=2), (0.01, 0.003)) + QuadraticDamping(eta2=0.5) + RayleighDamping(beta=2e-6)
)
start = static_equilibrium(model, tip_force=(0.06, 0.0))
run = simulate(model, damping=law, start=start, duration=0.9)

swing = np.ptp(run.tip[:, 0]) / model.beam.length
lost = run.energy[0] - run.energy[-1]
balance = abs(run.balance_error[-1]) / lost

if __name__ == "__main__":
    import matplotlib.pyplot as plt

    print(f"swing {swing:.3f} L, {1e3 * lost:.4f} mJ lost to damping, relative energy balance error {balance:.0e}")
    plt.plot(run.time, 1e3 * run.kinetic_energy, label="kinetic")
    plt.plot(run.time, 1e3 * (run.strain_energy + run.potential_energy - run.energy[-1]), label="strain and potential")
    plt.plot(run.time, 1e3 * run.dissipated_energy, label="lost to damping")
    plt.gca().set(xlabel="time, s", ylabel="energy, mJ", title=f"relative energy balance error {balance:.0e}")
    plt.legend()
    plt.show()
