"""The posterior distribution of the unknowns of a fit: its density, and samples of it."""
