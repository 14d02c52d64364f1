"""The beam and its equations of motion, symbolic in CasADi: Section 2 of the paper, Eqs. (1) to (8).

``beam`` holds geometry, material and gravity, ``supports`` what holds it and is attached to it, and ``lumped`` the
properties by name.  ``strain`` has the shape functions, Eqs. (2) and (3), and the strain measures in Eq. (8);
``element`` the energies, Eqs. (5) and (8), and the forces and matrices of one element and of what is attached, Eqs. (6)
and (7); ``model`` assembles them.  ``loads`` has the loads on a beam at rest.  Nothing here imports scipy or matplotlib.
"""
