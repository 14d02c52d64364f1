"""The inner Functions of a Radau step at one node: corrections, prediction, and turning along with the slope.

Values that belong to the three stages of a node are a column of 12, one stage after the other.  Like the Functions of
an element (``kernels``), those of a node know neither the mesh nor any number of the beam.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import casadi as cs
import numpy as np

from ancf_casadi.kernels import kernel
from ancf_casadi.model import NODE
from ancf_casadi.tableau import RADAU, STAGES


@dataclass(frozen=True, eq=False)
class Nodes:
    """The Functions of a node, each for several nodes at once.

    Parameters
    ----------
    make : callable
        Compiles a Function, or leaves it to the virtual machine.
    """

    make: Callable[[cs.Function], cs.Function]

    @cached_property
    def corrected(self) -> cs.Function:
        """(Z, dW real (4,), dW complex (8,), q, v, h, reference) -> Z less T dW, turned forth, and e, e_t and e_tt."""
        z, q, v = cs.SX.sym("Z", NODE, STAGES), cs.SX.sym("q", NODE), cs.SX.sym("v", NODE)
        real, pair = cs.SX.sym("real", NODE), cs.SX.sym("pair", 2, NODE)
        h, reference = cs.SX.sym("h"), cs.SX.sym("reference", NODE)
        corrections = cs.horzcat(real, pair.T) @ cs.DM(RADAU.transform).T
        turned = [_turned(corrections[:, i], reference, q + z[:, i]) for i in range(STAGES)]
        new, inverse = z - cs.horzcat(*turned), cs.DM(RADAU.inverse).T
        rates = new @ inverse / h
        accelerations = (rates - cs.repmat(v, 1, STAGES)) @ inverse / h
        outputs = [new, cs.repmat(q, 1, STAGES) + new, rates, accelerations]
        return self._function("corrected", [cs.vec(z), real, cs.vec(pair), q, v, h, reference], outputs)

    @cached_property
    def returned(self) -> cs.Function:
        """(R, e, reference) -> T^-1 R real (4,) and complex (8,), turned back."""
        forces, e = cs.SX.sym("R", NODE, STAGES), cs.SX.sym("e", NODE, STAGES)
        reference = cs.SX.sym("reference", NODE)
        turned = cs.horzcat(*(_turned(forces[:, i], e[:, i], reference) for i in range(STAGES)))
        r = turned @ cs.DM(np.linalg.inv(RADAU.transform)).T
        return self._function("returned", [cs.vec(forces), cs.vec(e), reference], [r[:, 0], r[:, 1:].T])

    @cached_property
    def turned(self) -> cs.Function:
        """(vector, first, second) -> the vector turned by the angle from the slope in the first to the second."""
        vectors = [cs.SX.sym(name, NODE) for name in ("vector", "first", "second")]
        return self._function("turned", vectors, [_turned(*vectors)])

    @cached_property
    def extrapolated(self) -> cs.Function:
        """(vector at the start and the stages of a step (8,), shares (9,)) -> the vector at the next stages (6,).

        The shares are those of the old stages in the polynomial at each new one; it runs through logarithms: the length
        of the vector relative to the start, and its angle from there.
        """
        vectors, shares = cs.SX.sym("vectors", 2, STAGES + 1), cs.SX.sym("shares", STAGES, STAGES)
        first, *rest = cs.horzsplit(vectors)
        exponents = cs.horzcat(*(_logarithm(first, vector) for vector in rest)) @ shares
        outputs = [_exponential(first, exponents[:, i]) for i in range(STAGES)]
        return self._function("extrapolated", [cs.vec(vectors), cs.vec(shares)], [cs.vertcat(*outputs)])

    @cached_property
    def shares(self) -> cs.Function:
        """Ratio of a step to the one before -> the shares (9,) of ``extrapolated``."""
        ratio, known = cs.SX.sym("ratio"), [0.0, *RADAU.nodes.tolist()]
        columns = [cs.vertcat(*_lagrange(known, 1 + c * ratio)[1:]) for c in RADAU.nodes.tolist()]
        return cs.Function("shares", [ratio], [cs.vertcat(*columns)])

    def _function(self, name: str, inputs: list[cs.SX], outputs: list[cs.SX]) -> cs.Function:
        columns = [cs.vec(output) for output in outputs]
        return self.make(kernel(name, inputs, columns, is_diff_in=[False] * len(inputs)))


def _turned(vector: cs.SX, first: cs.SX, second: cs.SX) -> cs.SX:
    """Turn position and slope by the angle from the slope in one configuration to that in another."""
    x0, y0, x1, y1 = first[2], first[3], second[2], second[3]
    cosine, sine = x0 * x1 + y0 * y1, x0 * y1 - y0 * x1
    size = cs.sqrt(cosine**2 + sine**2)
    cosine, sine = cosine / size, sine / size
    pairs = cs.reshape(vector, 2, 2)
    return cs.vec(cs.vertcat(cosine * pairs[0, :] - sine * pairs[1, :], sine * pairs[0, :] + cosine * pairs[1, :]))


def _logarithm(first: cs.SX, second: cs.SX) -> cs.SX:
    """Return the logarithm of the ratio of lengths, and the angle, from one vector to another."""
    dot, cross = cs.dot(first, second), first[0] * second[1] - first[1] * second[0]
    return cs.vertcat(cs.log((dot**2 + cross**2) / cs.sumsqr(first) ** 2) / 2, cs.atan2(cross, dot))


def _exponential(first: cs.SX, exponent: cs.SX) -> cs.SX:
    """Return the vector with a given logarithm from another."""
    size = cs.exp(exponent[0])
    cosine, sine = size * cs.cos(exponent[1]), size * cs.sin(exponent[1])
    return cs.vertcat(cosine * first[0] - sine * first[1], sine * first[0] + cosine * first[1])


def _lagrange(nodes: list[float], x: cs.SX) -> list[cs.SX]:
    """Return Lagrange's polynomials of some nodes at x."""
    factors = [[(x - other) / (node - other) for other in nodes if other != node] for node in nodes]
    return [math.prod(one, start=cs.SX(1)) for one in factors]
