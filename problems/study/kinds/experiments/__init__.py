"""The kinds of parts with simulated experiments: a mode is driven at the clamp, stopped, and decays."""
