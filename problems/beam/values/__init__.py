"""Static tests and natural frequencies of a beam: records, the block of a fit, and predictions."""
