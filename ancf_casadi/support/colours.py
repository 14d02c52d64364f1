"""Colours of figures: records are black, what is computed from them is green; both keep their contrast in grey."""

MEASURED = "#222222"
COMPUTED = "#1b7f5c"
