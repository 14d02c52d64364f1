"""Air drag in the study: the drag behind eta1 and eta2, their effect on a decay, and one law for all modes.

``air`` converts eta2 to a drag coefficient and gives the viscous share of the damping.  ``effects`` simulates decays
under either coefficient beside Eq. (27), and ``characteristics`` puts them into the words of Table 6.  ``combined_law``
joins modal and quadratic damping for all modes and amplitudes; ``ratio_curves`` compares the laws over amplitude.
"""
