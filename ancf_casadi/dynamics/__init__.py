"""Large motion in time: the equation of motion, Eq. (6) with damping, the motion of the clamp, and the integrators.

``base_motion`` moves the clamp, and ``equations`` joins the model with a damping law and the clamp; ``element_forces``
has the Functions of one element.  ``start`` sets up a motion, ``simulation`` holds ``simulate``, ``integration``
chooses the integrator, ``segments`` divides the time, and ``trajectory`` is the result.  ``derivatives`` differentiates
a motion, and ``signals`` names the inputs and outputs of exported models.

The project has five time steppers, each for a task that the others do not serve:

    IDAS, order 2 (``idas``)              the full beam, undamped or nearly so: adds the least numerical damping per
                                          unit of computing time while no mode of the mesh vibrates
    Radau IIA, order 5 (``radau``)        the full beam in large, fast or struck motion: passes over vibrations of the
                                          mesh, takes longer steps, and yields exact derivatives of its steps
    steps of the reduced model            a few modal coordinates without fast modes: explicit steps without Newton's
    (``reduction.stepping``)              method, compiled as one loop
    one mode (``decay.one_mode``)         Eq. (26) in the variables of its free oscillation, with sensitivities, for
                                          fits that integrate thousands of decays
    exported step                         one implicit step of order 2 as a Function without an integrator, because
    (``export.functions.step``)           C code and controllers cannot call one
"""
