"""
A fit with the optimiser of SciPy
=================================

SciPy's optimiser finds the thickness profile of a strip from its measured frequencies.

Five frequencies determine three unknown factors, on the thickness at the clamp, in the middle and at the tip, with
linear interpolation between.  The exported Function returns the frequencies with their exact Jacobian, through
equilibrium and modes.
"""

import casadi as cs
import numpy as np
from scipy.optimize import least_squares

from ancf_casadi import Beam, Model, natural_modes
from ancf_casadi.export import beam_functions, values

guess = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3, density=8000.0, elastic_modulus=210e9, elements=10)
truth = np.array([1.15, 0.9, 1.05])

s = (np.arange(guess.elements) + 0.5) / guess.elements  # middles of the elements
lines = np.column_stack([np.maximum(0, 1 - 2 * s), 1 - abs(2 * s - 1), np.maximum(0, 2 * s - 1)])
strip = guess.with_(thickness=guess.thickness[0] * lines @ truth)
measured = natural_modes(Model(strip)).frequencies

functions = beam_functions(Model(guess))
factors = cs.MX.sym("factors", 3)
p = cs.MX(values(functions.parameters))
names = [signal.name for signal in functions.parameters]
p[[names.index(f"thickness_{i + 1}") for i in range(guess.elements)]] *= cs.DM(lines) @ factors
errors = functions.frequencies(p) / measured - 1
residuals = cs.Function("residuals", [factors], [errors, cs.jacobian(errors, factors)])

fit = least_squares(
    lambda x: residuals(x)[0].full().ravel(), np.ones(3), jac=lambda x: residuals(x)[1].full(), xtol=1e-12, gtol=1e-12
)

if __name__ == "__main__":
    import matplotlib.pyplot as plt

    print("found", *(f"{x:.9f}" for x in fit.x), "of", *truth, f"in {fit.nfev} evaluations")
    middles = s * guess.length
    plt.plot(middles, 1e3 * np.array(guess.thickness), "--", label="guess")
    plt.plot(middles, 1e3 * np.array(strip.thickness), "o", label="truth")
    plt.plot(middles, 1e3 * guess.thickness[0] * lines @ fit.x, label="found")
    plt.gca().set(xlabel="distance from the clamp, m", ylabel="thickness, mm")
    plt.legend()
    plt.show()
