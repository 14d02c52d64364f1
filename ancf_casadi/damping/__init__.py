"""External damping laws: proportional, quadratic and generic, and their sums.

A law adds the force Q_damp(e, e_t) to the left of the equation of motion, M e_tt + Q_damp + Q_e = Q_g.  The rates e_t
are those of the laboratory frame, so that external damping is motion against the still air.

    proportional    Q = alpha M e_t + beta (stiffness-proportional part),          Eq. (14)
    quadratic       Q = int S^T (gamma1 v + gamma2 |v| v) dp,                       Eq. (19), (23)
    generic         Q = R M Phi diag(2 zeta omega) Phi^T M R^T e_t,                 Eq. (32), R: ``turning``

A force is the sum of a local part, written with the element Functions and sparse, and of a part R B diag(d) B^T R^T e_t
of low rank, which an integrator can keep sparse by making B^T R^T e_t its unknowns; R turns with the clamp.  Both are
symbolic in the properties of the beam and in the parameters of the law.  A coefficient of exactly 0 is no parameter:
its term is absent.

Each law tells the equivalent damping ratio it gives a mode that swings with a tip amplitude A: the viscous ratio with
the same loss of energy in a period.

References
----------
"Comparison of external damping models in a large deformation problem", Section 4; with Eq. (18), (31) and the units of
eta2 put right (damping on the left; Phi^-T = M Phi; 1/m).
"""

from ancf_casadi.damping.generic import ModalDamping
from ancf_casadi.damping.law import DampingLaw, Forces, SumOfLaws
from ancf_casadi.damping.proportional import ProportionalStiffness, RayleighDamping
from ancf_casadi.damping.quadratic import DRAG_CONSTANT, QuadraticDamping

__all__ = [
    "DRAG_CONSTANT",
    "DampingLaw",
    "Forces",
    "ModalDamping",
    "ProportionalStiffness",
    "QuadraticDamping",
    "RayleighDamping",
    "SumOfLaws",
]
