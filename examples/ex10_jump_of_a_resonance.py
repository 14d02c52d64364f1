"""
The jump of a resonance
=======================

The clamp of a hanging strip shakes near the frequency of mode 2; its steady vibration jumps.

Mode 2 softens: its frequency falls with the amplitude.  At 0.2 mm, the resonance leans so far that three steady
vibrations exist over a range of frequencies, one of them unstable.  A slow sweep upwards jumps at the upper end of this
range, a sweep downwards at its lower end.  The same strip in air, under quadratic drag, has a flatter resonance.
"""

from ancf_casadi import (
    Beam,
    HarmonicBase,
    ModalDamping,
    Model,
    QuadraticDamping,
    frequency_response,
    natural_modes,
    reduce_model,
)

beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3, density=8000.0, elastic_modulus=210e9, elements=8)
model = Model(beam)
modes = natural_modes(model, count=4)
material = ModalDamping(modes, ratios=(0.003, 0.003))
laws = {"material": material, "material and air": material + QuadraticDamping(eta2=0.3)}

base = HarmonicBase(amplitude=2e-4, frequency=10.6)
curves = {
    name: frequency_response(reduce_model(model, modes=modes, damping=law), (10.2, 10.9), base=base)
    for name, law in laws.items()
}

if __name__ == "__main__":
    for name, curve in curves.items():
        peak = curve.amplitude().argmax()
        print(f"{name}: peak {1e3 * curve.amplitude()[peak]:.1f} mm at {curve.frequencies[peak]:.2f} Hz")
        for bifurcation in curve.bifurcations:
            print(f"  {bifurcation.kind} at {bifurcation.motion.frequency:.3f} Hz")
        print("  a sweep upwards jumps at", curve.jumps.up, "Hz, downwards at", curve.jumps.down, "Hz")
    curves["material"].figure().savefig("jump.png")
