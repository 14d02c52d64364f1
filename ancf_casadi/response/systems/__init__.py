"""Second-order systems with an excitation: the small interface, and the full and the reduced beam behind it."""
