"""Reference values from other programs, laboratories and closed forms.

References
----------
Dowell and Traybar 1975, "An experimental study of the nonlinear stiffness of a rotor blade undergoing flap, lag and
twist deformations" (the Princeton beam).
Obrezkov, Mikkola and Matikainen 2022, "Performance review of locking alleviation methods for continuum ANCF beam
elements", Nonlinear Dynamics (its tip deflections by beam elements of ANSYS).
Simo and Vu-Quoc 1986, "On the dynamics of flexible beams under large overall motions - the plane case", Journal of
Applied Mechanics (the spin-up).
"""

import numpy as np
import pytest
import scipy.sparse.linalg

from ancf_casadi import Beam, Model, RayleighDamping, SampledBase, simulate, static_equilibrium

BOTH = pytest.mark.parametrize("method", ["idas", "radau"])

# ------------------------------------------------------------------------------------------------- the Princeton beam

PRINCETON = {"length": 0.508, "elastic_modulus": 71.7e9, "density": 2700.0}  # m, Pa; the density has no influence
WIDE, THIN = 12.3777e-3, 3.2024e-3  # m
SHEAR_STIFFNESS = 5 / 6 * 71.7e9 / (2 * 1.31) * WIDE * THIN  # k G A of a rectangle, Poisson's ratio 0.31; N


def princeton_tip(force, width, thickness):
    """Deflection of the tip under a dead force normal to the beam, m."""
    sides = {"width": width, "thickness": thickness, "elements": 20, "axis": (1.0, 0.0), "gravity": (0.0, 0.0)}
    return static_equilibrium(Model(Beam.uniform(**PRINCETON, **sides)), tip_force=(0.0, force)).tip[1]


@pytest.mark.parametrize(("force", "deflection"), [(8.896, 0.146245978), (13.345, 0.200677707)])
def test_the_princeton_beam_bends_flapwise_like_beam_elements_of_ansys(force, deflection):
    """Obrezkov, Mikkola and Matikainen 2022."""
    assert princeton_tip(force, WIDE, THIN) == pytest.approx(deflection, rel=3e-5)


@pytest.mark.parametrize(("force", "deflection"), [(8.896, 0.01071417630), (13.345, 0.01606423724)])
def test_the_princeton_beam_bends_edgewise_like_beam_elements_of_ansys_except_for_shear(force, deflection):
    """Obrezkov, Mikkola and Matikainen 2022; an Euler-Bernoulli beam lacks F L/(k G A), 5e-4 of the deflection."""
    bending = princeton_tip(force, THIN, WIDE)
    shear = force * PRINCETON["length"] / SHEAR_STIFFNESS
    assert shear == pytest.approx(4.7e-4 * deflection, rel=0.02)
    assert bending == pytest.approx(deflection - shear, rel=1.5e-4)


# -------------------------------------------------------------------------------------------------- steady rotation

ARM, SPEED, SPIN_UP = 10.0, 6.0, 15.0  # m, rad/s, s
AXIAL, LINE, BENDING = 2.8e7, 1.2, 1.4e4  # E A (N), line density (kg/m), E I (N m^2)
WAVE = SPEED * np.sqrt(LINE / AXIAL)
EXTENSION = np.tan(WAVE * ARM) / WAVE - ARM  # m, of E A r'' = -mu omega^2 r with E A (|r'| - 1) = 0 at the tip


def arm(elements):
    """The beam of Simo and Vu-Quoc, as a rectangle 1 m wide."""
    thickness = np.sqrt(12 * BENDING / AXIAL)
    return Model(
        Beam.uniform(
            length=ARM,
            width=1.0,
            thickness=thickness,
            density=LINE / thickness,
            elastic_modulus=AXIAL / thickness,
            elements=elements,
            axis=(1.0, 0.0),
            gravity=(0.0, 0.0),
        )
    )


def stretched(model):
    """Coordinates of the steadily rotating beam in the rotating frame: Q_e(e) = omega^2 M e."""
    e, free, p = model.straight.copy(), slice(4, model.size), model.properties
    load = SPEED**2 * model.mass(p).sparse()
    for _ in range(6):
        unbalance = (model.elastic_force(e, p).full().ravel() - load @ e)[free]
        tangent = (model.tangent_stiffness(e, p).sparse() - load)[free, free]
        correction = scipy.sparse.linalg.spsolve(tangent.tocsc(), unbalance)
        e[free] -= correction
    assert abs(correction).max() < 1e-12 * ARM
    return e


def test_the_extension_of_a_rotating_beam_converges_to_the_closed_form():
    """The clamp keeps the first slope at length 1 (the closed form has 1 + 7.7e-5), an error of order 2."""
    assert pytest.approx(5.14317e-4, rel=2e-6) == EXTENSION
    errors = [stretched(arm(elements))[-4] - ARM - EXTENSION for elements in (4, 8, 16)]
    np.testing.assert_allclose(-np.diff(np.log2(errors)), 2.0, atol=0.05)
    assert errors[-1] < 2.5e-4 * EXTENSION


@pytest.mark.slow
def test_after_the_spin_up_of_simo_and_vu_quoc_the_beam_has_the_extension_of_steady_rotation():
    """Angle theta = (6/15) (t^2/2 + (15/(2 pi))^2 (cos(2 pi t/15) - 1)) up to 15 s, then 6 t - 45."""
    time, slow = np.linspace(0.0, 18.0, 361), SPIN_UP / (2 * np.pi)
    spun_up = SPEED / SPIN_UP * (time**2 / 2 + slow**2 * (np.cos(time / slow) - 1))
    angle = np.where(time < SPIN_UP, spun_up, SPEED * (time - SPIN_UP / 2))
    base = SampledBase(time, np.zeros((time.size, 2)), angle)
    law = RayleighDamping(beta=1e-2)
    run = simulate(arm(8), damping=law, base=base, duration=17.0, sample_rate=20.0, method="radau", tolerance=1e-6)
    steady = run.time > 16.0
    lag = np.angle(np.exp(1j * (np.arctan2(run.tip[:, 1], run.tip[:, 0]) - angle[: run.time.size])))
    assert lag.min() * ARM < -0.5  # the tip trails by half a metre during the spin-up
    assert np.linalg.norm(run.tip[steady], axis=1) - ARM == pytest.approx(EXTENSION, rel=2e-3)
    assert abs(lag[steady]).max() * ARM < 5e-3
    assert abs(run.balance_error).max() < 1e-4 * run.kinetic_energy.max()
