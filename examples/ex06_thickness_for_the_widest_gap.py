"""
Thickness for the widest gap between frequencies
================================================

IPOPT finds the thickness profile with the widest gap between the first two frequencies at a given mass.

The thickness of each of 8 elements may change by a factor of 2.  The frequencies are a CasADi Function of the
parameters that includes the equilibrium under gravity and has exact derivatives.
"""

import casadi as cs
import numpy as np

from ancf_casadi import Beam, Model, natural_modes
from ancf_casadi.export import beam_functions, values

beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3, density=8000.0, elastic_modulus=210e9, elements=8)
functions = beam_functions(Model(beam), modes=2)
names = [signal.name for signal in functions.parameters]
where = [names.index(f"thickness_{i}") for i in range(1, beam.elements + 1)]

opti = cs.Opti()
factors = opti.variable(beam.elements)
p = cs.MX(values(functions.parameters))
p[where] *= factors
f = functions.frequencies(p)
opti.minimize(-(f[1] - f[0]))
opti.subject_to(cs.sum1(factors) == beam.elements)  # constant mass
opti.subject_to(opti.bounded(0.5, factors, 2.0))
opti.set_initial(factors, 1.0)
opti.solver("ipopt", {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes"})
solution = opti.solve()

profile = np.array(solution.value(factors)) * beam.thickness[0]
before = natural_modes(Model(beam), count=2).frequencies
after = natural_modes(Model(beam.with_(thickness=profile)), count=2).frequencies  # not by the exported Functions

if __name__ == "__main__":
    import matplotlib.pyplot as plt

    print("thickness", *(f"{1e3 * h:.3f}" for h in profile), "mm")
    print("gap", f"{before[1] - before[0]:.3f} Hz before, {after[1] - after[0]:.3f} Hz after")
    ends = np.linspace(0.0, beam.length, beam.elements + 1)
    plt.stairs(1e3 * np.array(beam.thickness), ends, baseline=None, label="before", linestyle="--")
    plt.stairs(1e3 * profile, ends, baseline=None, label="after", linewidth=2)
    plt.gca().set(xlabel="distance from the clamp, m", ylabel="thickness, mm", ylim=(0.0, None))
    plt.legend()
    plt.show()
