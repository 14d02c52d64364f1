"""Static equilibrium and small vibration about it.

``equilibrium`` holds the only Newton solver, ``eigensolver`` the only solver of the eigenvalue problem, Eq. (30);
``assembly`` sums up forces and matrices as numbers, ``sensitivities`` has the exact derivatives of frequencies and mode
shapes, and ``following`` tracks modes while the properties change.
"""
