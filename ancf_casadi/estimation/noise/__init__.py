"""The noise of a fit, from its residuals: its covariance, and one file per way to estimate it."""
