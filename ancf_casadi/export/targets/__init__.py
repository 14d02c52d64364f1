"""The forms in which a model is written: C99, FMU, and files of CasADi Functions."""
