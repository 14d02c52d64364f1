"""Functions of CasADi that are written in Python.

Lifetime.  Expressions keep CasADi's own Functions alive, but not callbacks, which are Functions written in Python.
Each callback is therefore wrapped in a Function of CasADi and must live as long as the latter: ``_ALIVE`` pairs a weak
reference to the Function with its callback, and adding a pair drops those whose Function is gone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import casadi as cs
import numpy as np

from ancf_casadi.exceptions import AncfError
from ancf_casadi.support.arrays import Array

_ALIVE: list[tuple[cs.WeakRef, cs.Callback]] = []  # Functions that call a callback, and the callbacks


def callback_function(callback: cs.Callback, name: str) -> cs.Function:
    """Return a Function that calls a callback, and keep the callback alive as long as the Function."""
    inputs = callback.mx_in()
    names = callback.name_in(), callback.name_out()
    function: cs.Function = cs.Function(name, inputs, callback.call(inputs), *names, {"never_inline": True})
    _ALIVE[:] = [pair for pair in _ALIVE if pair[0].alive()]
    _ALIVE.append((cs.WeakRef(function), callback))
    return function


class Differentiable(cs.Callback):
    """A vector-valued Python function as a callback with an exact Jacobian; nan where it fails.

    ``respond`` returns the values (m,) and their Jacobian (m, n) for inputs (n,); ``size`` is m, and ``inputs`` is n.
    With ``jacobian``, the callback returns the Jacobian in place of the values.  Keep a reference while CasADi uses it.
    """

    def __init__(
        self, respond: Callable[[Array], tuple[Array, Array]], size: int, inputs: int, *, jacobian: bool = False
    ) -> None:
        cs.Callback.__init__(self)
        self._respond, self._size, self._inputs, self._part = respond, size, inputs, int(jacobian)
        self._last: tuple[Array, tuple[Array, Array]] | None = None
        self._jacobians: list[Differentiable] = []
        self.failure = ""  # reason of the first failure
        self.construct("response", {})

    def at(self, inputs: Array) -> tuple[Array, Array]:
        """Return values and Jacobian; those for the last inputs are cached."""
        if self._last is None or not np.array_equal(self._last[0], inputs):
            try:
                response = self._respond(inputs)
            except (AncfError, np.linalg.LinAlgError) as error:
                self.failure = self.failure or str(error)
                response = np.full(self._size, math.nan), np.full((self._size, self._inputs), math.nan)
            self._last = inputs, response
        return self._last[1]

    def get_sparsity_in(self, i: int) -> cs.Sparsity:
        """Return the shape of the inputs."""
        return cs.Sparsity.dense(self._inputs, 1)

    def get_sparsity_out(self, i: int) -> cs.Sparsity:
        """Return the shape of the output."""
        return cs.Sparsity.dense(self._size, self._inputs if self._part else 1)

    def has_eval_buffer(self) -> bool:
        """Return True: inputs and outputs are buffers, because the conversion of a large array to DM is slow."""
        return True

    def eval_buffer(self, arg: Sequence[memoryview], res: Sequence[memoryview]) -> int:
        """Write the values, or the Jacobian, column after column."""
        output = self.at(np.frombuffer(arg[0]).copy())[self._part]
        np.frombuffer(res[0])[:] = np.ravel(output, order="F")
        return 0

    def has_jacobian(self) -> bool:
        """Return whether the derivatives of the output are known."""
        return not self._part

    def get_jacobian(self, name: str, inames: Any, onames: Any, opts: Any) -> cs.Function:
        """Return the Jacobian as a Function of inputs and values, which it does not need."""
        jacobian = Differentiable(self.at, self._size, self._inputs, jacobian=True)
        self._jacobians.append(jacobian)
        inputs, values = cs.MX.sym("inputs", self._inputs), cs.MX.sym("values", cs.Sparsity(self._size, 1))
        return cs.Function(name, [inputs, values], [jacobian(inputs)], inames, onames)
