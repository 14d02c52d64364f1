"""External damping laws: those of Section 4 of the paper, dry friction, and sums of laws.

A law adds the force Q_damp(e, e_t) to the left-hand side of the equation of motion, M e_tt + Q_damp + Q_e = Q_g.  The
velocities e_t are those in the laboratory frame: external damping resists motion relative to the air, which is still
unless a law has a flow.

    proportional    Rayleigh (proportional)  Q = alpha M e_t + beta (stiffness part),              Eqs. (11)-(16)
    quadratic       quadratic                Q = int S^T (gamma1 v + gamma2 |v| v) dp,             Eqs. (19)-(26)
    friction        dry friction             Q = int S^T gamma0 v/|v| dp
    viscoelastic    viscoelastic             Q = J^T D sum_b g_b y_b, from the history of the strains
    generic         modal (generic)          Q = R M Phi diag(2 zeta omega) Phi^T M R^T e_t,       Eqs. (28)-(32)
    law             parameters of a law, sums of laws, rotation R of the modal law with the clamp

Each force has a local part, a sum over the elements, and a low-rank part R B diag(d) B^T R^T e_t, which the integrators
keep apart so that their matrices stay sparse.  Both parts are symbolic in the properties of the beam and in the
parameters of the law.  A coefficient of exactly 0 is not a parameter, and its term is left out.

Each law predicts its equivalent damping ratio for a mode with the tip amplitude A: the ratio of the viscous damping
that loses the same energy per period.

References
----------
"Comparison of external damping models in a large deformation problem", Section 4.  Corrected here: the sign of Eq. (18)
(damping is on the left), Eq. (31) (Phi^-T = M Phi), and the unit of eta2 (1/m; the tables of the paper use 1/mm).
"""

from ancf_casadi.damping.friction import FRICTION_CONSTANT, FrictionDamping
from ancf_casadi.damping.generic import ModalDamping
from ancf_casadi.damping.law import DampingLaw, Forces, Parameter, SumOfLaws
from ancf_casadi.damping.proportional import ProportionalStiffness, RayleighDamping
from ancf_casadi.damping.quadratic import DRAG_CONSTANT, QuadraticDamping
from ancf_casadi.damping.viscoelastic import ViscoelasticDamping

__all__ = [
    "DRAG_CONSTANT",
    "FRICTION_CONSTANT",
    "DampingLaw",
    "Forces",
    "FrictionDamping",
    "ModalDamping",
    "Parameter",
    "ProportionalStiffness",
    "QuadraticDamping",
    "RayleighDamping",
    "SumOfLaws",
    "ViscoelasticDamping",
]
