"""Damping ratio of each mode against its amplitude, under several laws."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ancf_casadi.damping import DampingLaw
from ancf_casadi.exceptions import InputError
from ancf_casadi.support.arrays import Array
from ancf_casadi.support.inputs import array, check_instance
from ancf_casadi.vibration.modes import Modes


@dataclass(frozen=True, eq=False)
class RatioCurves:
    """Damping ratio of each mode against its amplitude, under several laws.

    Parameters
    ----------
    amplitudes : ndarray
        Tip amplitudes (k,), m.
    ratios : mapping of str to ndarray
        Damping ratios (k, m) under each law by name, one column per mode.
    """

    amplitudes: Array
    ratios: Mapping[str, Array]


def ratio_curves(laws: Mapping[str, DampingLaw], modes: Modes, amplitudes: ArrayLike) -> RatioCurves:
    """Return the equivalent damping ratio of each mode at each amplitude under each law.

    Parameters
    ----------
    laws : mapping of str to DampingLaw
        The laws by name.
    modes : Modes
        Modes of the beam.
    amplitudes : array_like
        Tip amplitudes (k,), m, none negative.

    Raises
    ------
    InputError
        If an amplitude is negative or not finite, or there are none.
    """
    check_instance(modes, "modes", Modes)
    tip = array(amplitudes, "amplitudes").ravel()
    if not len(tip) or tip.min() < 0.0:
        raise InputError("must be one or more numbers, none negative", "amplitudes")
    return RatioCurves(
        amplitudes=tip,
        ratios={
            name: np.array([law.damping_ratios(modes, np.full(modes.count, one)) for one in tip.tolist()])
            for name, law in laws.items()
        },
    )
