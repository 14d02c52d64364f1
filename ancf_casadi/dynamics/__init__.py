"""Large motion in time: the equation of motion, the motion of the clamp, and the integrators.

``equations`` joins the model, Eq. (6), with a damping law and the clamp of ``base_motion``; ``simulation`` holds
``simulate``, ``idas`` and ``radau`` the integrators that it chooses from, ``trajectory`` its result.  ``derivatives``
differentiates a motion.
"""
