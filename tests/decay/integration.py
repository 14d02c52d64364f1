"""The reference for closed forms: an integrator of order 8."""

from collections.abc import Callable, Sequence

import numpy as np
from scipy.integrate import solve_ivp


def integrated(rates: Callable[..., list[float]], start: Sequence[float], times: np.ndarray) -> np.ndarray:
    """Return the states (n, m) at times from 0 on, whose rates are a function of the state."""
    span = (0.0, times[-1])
    return solve_ivp(lambda _, y: rates(*y), span, start, t_eval=times, method="DOP853", rtol=1e-12, atol=1e-17).y


def drag_motion(η1: float, η2: float, ω: float, start: Sequence[float], times: np.ndarray) -> np.ndarray:
    """Return displacement and velocity of a mode under quadratic damping, Eq. (26)."""
    return integrated(lambda r, v: [v, -η1 * v - η2 * v * abs(v) - ω**2 * r], start, times)
