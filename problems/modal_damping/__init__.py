"""Laws from modal damping: Rayleigh damping, Eq. (17), one law of air drag for all modes, and the drag of a strip."""
