"""Drawings of the paper that show no measurement: the element, Figure 1, and the assumed deflection, Figure 11."""
