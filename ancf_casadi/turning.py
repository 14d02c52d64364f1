"""Corrections, residuals and predictions that turn with the beam.

The axial stiffness of a thin beam is thousands of times its bending stiffness, and its direction turns with the beam:
matrices taken in one configuration know little of the next.  But the axial strains depend on the slopes r'(p_g) at the
two Gauss points of each element alone, on their lengths; and these slopes determine the nodes: r' is quadratic in an
element of length l, so that

    r_k+1 = r_k + l/2 (r'_1 + r'_2),    tau_k+1 = tau_k + (r'_2 - r'_1)/(g_2 - g_1),    g = 1/2 -+ sqrt(3)/6.

Corrections.  With G from the free coordinates to these slopes, and R turning each slope by the angle between two
configurations, X = G^-1 R G takes corrections from one to the other.  The axial stiffness X^T K X is then the same in
both, inertia and bending nearly so.  Residuals go the other way, by X^T.

Prediction.  Motions are continued in the logarithms, length and angle, of the slopes, which keeps extrapolation errors of
the angles out of the axial strains.

Behind an elastic clamp, position and slope of the first node of the beam take the part of one more pair of slopes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as cs
import numpy as np

from ancf_casadi.model import NODE, Model
from ancf_casadi.shape import gauss, hermite_slope


@dataclass(frozen=True, eq=False)
class Turning:
    """The slopes at the Gauss points of several configurations, such as the stages of a step, side by side.

    Nodes are arrays (4 c, nodes), one configuration of c below the other; pairs of slopes are arrays (4 c, elements),
    the x components of all configurations above the y components, with the elastic clamp, if any, as first column.
    Turns are the cosines above the sines of the angles of the pairs.

    Parameters
    ----------
    model : Model
        The beam.
    configurations : int
        Their number c.
    """

    model: Model
    configurations: int

    def turns(self, reference: cs.MX, e: cs.MX) -> cs.MX:
        """Return the turns from a reference (4 n + 4,) to the coordinates e of the configurations (4 n + 4, c)."""
        rows = 2 * self.configurations
        first, second = self._directions(cs.repmat(reference, 1, self.configurations)), self._directions(e)
        x, y, u, v = first[:rows, :], first[rows:, :], second[:rows, :], second[rows:, :]
        cosine, sine = x * u + y * v, x * v - y * u
        size = cs.sqrt(cosine**2 + sine**2)
        return cs.vertcat(cosine / size, sine / size)

    def forth(self, corrections: cs.MX, turns: cs.MX) -> cs.MX:
        """Return X dW for corrections of the free coordinates (N, c)."""
        nodes = self._stacked(cs.vertcat(cs.MX(NODE, self.configurations), corrections))
        left, right, clamp = self._to_pairs
        root = self.model.root
        pairs = left @ nodes[:, root:-1] + right @ nodes[:, root + 1 :]
        if root:
            pairs = cs.horzcat(clamp @ nodes[:, root], pairs)
        return self._unstacked(_running_sum(self._steps(_turned(pairs, turns))))

    def back(self, residuals: cs.MX, turns: cs.MX) -> cs.MX:
        """Return X^T R for residuals of the free coordinates (N, c)."""
        ahead = _running_sum(self._stacked(residuals), back=True)
        left, right, clamp = self._to_pairs
        root = self.model.root
        pairs = self._to_steps.T @ ahead[:, root:]
        if root:
            pairs = cs.horzcat(clamp @ ahead[:, 0], pairs)
        pairs = _turned(pairs, turns, back=True)
        none, own = cs.MX(NODE * self.configurations, 1), pairs[:, root:]
        nodes = cs.horzcat(left.T @ own, none) + cs.horzcat(none, right.T @ own)
        if root:
            nodes += cs.horzcat(clamp.T @ pairs[:, 0], cs.MX(nodes.shape[0], nodes.shape[1] - 1))
        return self._unstacked(nodes if root else nodes[:, 1:])

    def continued(self, shares: cs.MX, motion: cs.MX, clamped: cs.MX) -> cs.MX:
        """Continue a motion in the logarithms of the slopes, and return the free coordinates (N, c).

        ``motion`` (4 n + 4, k + 1) are coordinates at k + 1 instants; column i of ``shares`` (k, c) says how much of
        the logarithms from the first of them to the others is in configuration i, of which ``clamped`` (4, c) is the
        clamped node.
        """
        one, root, count = Turning(self.model, 1), self.model.root, self.configurations
        x, y, *others = [
            cs.vec(part)
            for k in range(motion.shape[1])
            for part in cs.vertsplit(one._directions(motion[:, k]), 2)  # noqa: SLF001
        ]
        square, lengths, angles = x**2 + y**2, [], []
        for u, v in zip(others[::2], others[1::2], strict=True):
            dot, cross = x * u + y * v, x * v - y * u
            lengths.append(cs.log((dot**2 + cross**2) / square**2) / 2)
            angles.append(cs.atan2(cross, dot))
        size, angle = cs.exp(cs.horzcat(*lengths) @ shares), cs.horzcat(*angles) @ shares
        cosine, sine = size * cs.cos(angle), size * cs.sin(angle)
        components = (cs.diag(x) @ cosine - cs.diag(y) @ sine, cs.diag(x) @ sine + cs.diag(y) @ cosine)
        pairs = cs.vertcat(*(cs.reshape(part[:, i], 2, -1) for part in components for i in range(count)))
        base = cs.vec(clamped)
        if root:
            clamp = self._to_pairs[2]
            still = cs.vec(cs.vertcat(cs.MX(2, count), clamped[2:, :]))
            slopes = cs.DM(np.kron(np.eye(count), np.diag([0.0, 0.0, 1.0, 1.0]))) @ (clamp.T @ pairs[:, 0]) - still
            pairs = cs.horzcat(clamp @ slopes, pairs[:, 1:])
        nodes = _running_sum(self._steps(pairs))
        return self._unstacked(nodes + cs.repmat(base, 1, nodes.shape[1]))

    @cached_property
    def _to_pairs(self) -> tuple[cs.DM, cs.DM, cs.DM]:
        """The slopes of an element from its first and second node, and the pair of the clamp from the node behind."""
        values = np.array([hermite_slope(xi, self.model.beam.element_length) for xi in gauss(2)[0].tolist()])
        return tuple(self._map(part) for part in (values[:, :2], values[:, 2:], np.eye(2)))

    @cached_property
    def _to_steps(self) -> cs.DM:
        """The steps of position and slope from one node to the next from the slopes between."""
        half, span = self.model.beam.element_length / 2, float(np.diff(gauss(2)[0])[0])
        return self._map(np.array([[half, -1 / span], [half, 1 / span]])).T

    def _map(self, values: np.ndarray) -> cs.DM:
        """Return what takes position and slope to two slopes by (2, 2) values, for all configurations."""
        plane, count = np.eye(2), self.configurations
        matrix = np.einsum("xX,cC,pk->xcpCkX", plane, np.eye(count), values)
        return cs.sparsify(cs.DM(matrix.reshape(NODE * count, NODE * count)))

    def _directions(self, e: cs.MX) -> cs.MX:
        """Return the pairs whose angles count; behind an elastic clamp that of the slope, twice."""
        nodes, root = self._stacked(e), self.model.root
        left, right, _ = self._to_pairs
        pairs = left @ nodes[:, root:-1] + right @ nodes[:, root + 1 :]
        if root:
            twice = self._map(np.array([[0.0, 1.0], [0.0, 1.0]]))
            pairs = cs.horzcat(twice @ nodes[:, 1], pairs)
        return pairs

    def _steps(self, pairs: cs.MX) -> cs.MX:
        """Return the steps from each node to the next."""
        if not self.model.root:
            return self._to_steps @ pairs
        return cs.horzcat(self._to_pairs[2].T @ pairs[:, 0], self._to_steps @ pairs[:, 1:])

    def _stacked(self, vectors: cs.MX) -> cs.MX:
        return cs.vertcat(*(cs.reshape(vectors[:, i], NODE, -1) for i in range(self.configurations)))

    def _unstacked(self, nodes: cs.MX) -> cs.MX:
        return cs.horzcat(*(cs.vec(part) for part in cs.vertsplit(nodes, NODE)))


def _turned(pairs: cs.MX, turns: cs.MX, *, back: bool = False) -> cs.MX:
    """Turn pairs of slopes, or turn them back."""
    (x, y), (cosine, sine) = (cs.vertsplit(part, part.shape[0] // 2) for part in (pairs, turns))
    if back:
        sine = -sine
    return cs.vertcat(cosine * x - sine * y, sine * x + cosine * y)


def _running_sum(columns: cs.MX, *, back: bool = False) -> cs.MX:
    """Return the sums of all columns up to each, or from each on; it takes as many operations as n has binary digits."""
    width = 1
    while width < columns.shape[1]:
        added = columns[:, width:] + columns[:, :-width]
        columns = cs.horzcat(added, columns[:, -width:]) if back else cs.horzcat(columns[:, :width], added)
        width *= 2
    return columns
