"""
Hanging, standing and weightless beams
======================================

Natural frequencies of a hanging, a standing and a weightless cantilever.

Gravity tensions or compresses a beam: f1 of the paper's steel strip is 1.6553 Hz without gravity (beta L = 1.8751),
1.8761 Hz hanging and 1.3994 Hz standing.
"""

import numpy as np

from ancf_casadi import Beam, Model, natural_modes

strip = {"length": 0.5, "width": 5e-3, "thickness": 0.5e-3, "density": 8000.0, "elastic_modulus": 210e9, "elements": 20}

hanging = natural_modes(Model(Beam.uniform(**strip, axis=(0.0, -1.0)))).frequencies
standing = natural_modes(Model(Beam.uniform(**strip, axis=(0.0, 1.0)))).frequencies
weightless = natural_modes(Model(Beam.uniform(**strip, gravity=(0.0, 0.0)))).frequencies

roots = np.array([1.875104069, 4.694091133, 7.854757438, 10.995540735, 14.137168391])  # of cos x cosh x = -1
speed = np.sqrt(210e9 / 8000.0) * 0.5e-3 / np.sqrt(12.0)
exact = roots**2 * speed / (2 * np.pi * 0.5**2)

if __name__ == "__main__":
    import matplotlib.pyplot as plt

    print("mode   hanging  standing  weightless  exact (weightless)")
    for row in zip(range(1, 6), hanging, standing, weightless, exact, strict=True):
        print("{:4d} {:9.4f} {:9.4f} {:11.4f} {:11.4f}   Hz".format(*row))
    plt.plot(range(1, 6), 100 * (hanging / weightless - 1), "^", label="hanging")
    plt.plot(range(1, 6), 100 * (standing / weightless - 1), "v", label="standing")
    plt.axhline(0.0, color="gray", linewidth=1)
    plt.gca().set(xlabel="mode", ylabel="frequency shift due to gravity, %", xticks=range(1, 6))
    plt.legend()
    plt.show()
