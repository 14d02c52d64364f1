"""
A hammer blow
=============

A hammer strikes the tip of a hanging strip; the decay that follows gives the damping of mode 1.

The force is a half sine of 5 ms, sampled at 5 kHz as by a load cell.  All the energy of the motion is the work of this
force, until damping dissipates it.  The sensor is at the node of mode 2, 0.78 L from the clamp, so its record shows
almost only mode 1.  The fit finds the blow in the record, and returns frequency and damping ratio of mode 1.
"""

import numpy as np

from ancf_casadi import Beam, Model, RayleighDamping, SampledLoad, natural_modes, simulate
from problems import fit_decay

beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3, density=8000.0, elastic_modulus=210e9, elements=8)
model, law = Model(beam), RayleighDamping(alpha=0.2, beta=5e-4)

time = np.linspace(0.5, 0.505, 26)
force = 0.02 * np.sin(np.pi * np.linspace(0.0, 1.0, 26))
blow = SampledLoad(time, np.column_stack([force, 0.0 * force]))
run = simulate(model, damping=law, load=blow, duration=12.0, sample_rate=200.0)
fit = fit_decay(run.time, run.position(0.78 * beam.length)[:, 0])

modes = natural_modes(model, count=1)
truth = float(modes.frequencies[0]), float(law.damping_ratios(modes, np.zeros(1))[0])

if __name__ == "__main__":
    print(
        f"work of the blow {1e6 * run.load_work[-1]:.3f} uJ, lost to damping {1e6 * run.dissipated_energy[-1]:.3f} uJ"
    )
    print(f"mode 1 of the model: {truth[0]:.5f} Hz, damping ratio {truth[1]:.5f}")
    print(fit.report())
    fit.figure().savefig("blow.png")
