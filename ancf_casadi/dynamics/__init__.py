"""Large motion in time: the equation of motion, Eq. (6) with damping, the motion of the clamp, and the integrators.

``base_motion`` moves the clamp and ``tip_load`` loads the tip, and ``excitation`` joins both; ``equations`` joins the
model with a damping law; ``element_forces`` has the Functions of one element.  ``start`` sets up a motion,
``simulation`` holds ``simulate``, ``segments`` divides the time, and ``trajectory`` is the result.
``derivatives`` differentiates a motion, and ``signals`` names the inputs and outputs of exported models.

The project has four time steppers, each for a task that the others do not serve:

    Radau IIA (``radau``)             full beam, the default: few long steps of order 5, which damp vibrations of the
                                      mesh and have exact derivatives (``derivatives``)
    IDAS (``idas``)                   full beam by an established solver, against which Radau is checked: many cheap
                                      steps of order 2, which resolve vibrations of the mesh
    reduced model                     a few modal coordinates without stiff modes: explicit exponential steps of order 4
    (``reduction.stepping``)          (Lawson), exact for small undamped motion, without a nonlinear system to solve
    exported step                     full beam outside the toolkit: one implicit step of order 2 as a plain Function,
    (``export.solved_functions``)     because C code and controllers cannot call an integrator
"""
