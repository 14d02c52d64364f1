"""Static equilibrium, and small vibration about it: the modes that Eq. (30) normalises.

``equilibrium`` has Newton's method for the balance of forces, ``eigensolver`` the solver of K phi = omega^2 M phi.
``assembly`` sums the forces and matrices of the elements as numbers.  ``modes`` holds the modes of a beam and
``modal_state`` those of a beam with varied properties, which it follows while the properties change, and the exact
derivatives of frequencies and mode shapes.
"""
