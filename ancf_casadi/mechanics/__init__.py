"""The beam and its equations of motion, symbolic in CasADi.

A ``Beam`` holds geometry, material and gravity; ``Model`` assembles its elements.  Eqs. (2) and (3) are in ``shape``,
the strain energy and the elastic force, Eqs. (6) and (8), and the mass and gravity, Eq. (7), in ``element``; the sums
over the elements are in ``model``.  Nothing here imports scipy or matplotlib.
"""
