"""The kinds of parts with steady vibration: response curves of a beam under harmonic excitation."""
