"""Estimates against a known truth, and the computed values of records."""

import numpy as np

from ancf_casadi.mechanics.lumped import PROPERTIES
from problems.beam.properties import property_owners, scaled_model

FACTORS = (*PROPERTIES, "tip_mass", "clamp_stiffness")
ONES = np.ones(len(FACTORS))


def scores(fit, truth):
    """Return the errors of the first estimates over their standard errors."""
    values, errors = (np.array([*column.values()])[: len(truth)] for column in (fit.estimates, fit.standard_errors))
    return (values - truth) / errors


def respond(record):
    """Return the function from factors on all properties to the values of a record and their Jacobian."""
    return record.response(property_owners(record.model.beam, FACTORS))


def changed(model, **factors):
    """Return a model with factors on its properties by name."""
    values = np.array([factors.get(name, 1.0) for name in FACTORS])
    return scaled_model(model, property_owners(model.beam, FACTORS), values)
