"""The beam and its equations of motion, symbolic in CasADi: Section 2 of the paper, Eqs. (1) to (8).

``beam`` holds geometry, material and gravity.  ``shape`` has the shape functions, Eqs. (2) and (3); ``strain`` the
strain measures in Eq. (8); ``element`` the energies, Eqs. (5) and (8), and the forces and matrices of one element,
Eqs. (6) and (7).  ``clamp`` and ``tip_mass`` are further elements, and ``point_load`` a load at a point of the beam.
``group`` places equal elements in the beam, and ``model`` assembles them.  Nothing here imports scipy or matplotlib.
"""
