"""The beam and its equations of motion, symbolic in CasADi: Section 2 of the paper, Eqs. (1) to (8).

``beam`` holds geometry, material and gravity.  ``strain`` has the shape functions, Eqs. (2) and (3), and the
strain measures in Eq. (8); ``element`` the energies, Eqs. (5) and (8), and the forces and matrices of one element, of
the elastic clamp and of the tip mass, Eqs. (6) and (7); ``model`` assembles them.  ``point_load`` is a load at a point
of the beam.  Nothing here imports scipy or matplotlib.
"""
