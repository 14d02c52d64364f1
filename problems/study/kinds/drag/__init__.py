"""The kinds of parts about air drag: decays under eta1 and eta2, damping along a decay, one law for all modes."""
