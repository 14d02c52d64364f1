"""Large motion in time: the equation of motion, Eq. (6) with damping, the motion of the clamp, and the integrators.

``base_motion`` moves the clamp and ``tip_load`` loads the tip, and ``excitation`` joins both and divides the time;
``equations`` joins the model with a damping law.  ``motion_setup`` sets up a motion: ``limits`` checks it, ``start``
finds its initial state, and ``tolerance`` its default tolerance.  ``simulation`` holds ``simulate``, and
``trajectory`` is the result.  ``derivatives`` differentiates a motion, and ``signals`` names the inputs and outputs of
exported models.  The table of the time steppers in ``docs/architecture.md`` tells why there is more than one.
"""
