"""
A circle from an end moment
===========================

A cantilever is bent to a full circle by the moment M = 2 pi E I/L at its end.

The curvature is M/(E I) everywhere, so the tip returns to the clamp.  With 20 elements, the gap between tip and
clamp is 8e-5 L.
"""

import numpy as np

from ancf_casadi import Beam, Model, static_equilibrium

beam = Beam.uniform(
    length=1.0,
    width=0.02,
    thickness=1e-3,
    density=8000.0,
    elastic_modulus=210e9,
    elements=20,
    axis=(1.0, 0.0),
    gravity=(0.0, 0.0),
)
bending_stiffness = beam.elastic_modulus[0] * beam.sections[0].second_moment
circle = static_equilibrium(Model(beam), tip_moment=2 * np.pi * bending_stiffness / beam.length)
gap = float(np.linalg.norm(circle.tip)) / beam.length
top = circle.position(beam.length / 2)  # the diameter of a circle of circumference L is L/pi

if __name__ == "__main__":
    import matplotlib.pyplot as plt

    print(f"gap between tip and clamp {gap:.1e} L, diameter of the circle {top[1] / beam.length:.4f} L")
    plt.plot(*np.array([circle.position(s) for s in np.linspace(0.0, beam.length, 200)]).T)
    plt.gca().set(aspect="equal", xlabel="x, m", ylabel="y, m", title=f"gap {gap:.1e} L")
    plt.show()
