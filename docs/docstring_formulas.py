"""Typeset the formulas of docstrings, which are plain text in the code, for the reference."""

from __future__ import annotations

import re
from typing import Any

MODAL_MASS = r"\boldsymbol{\varphi}^T \mathbf{M} \boldsymbol{\varphi}"
FORMULAS = {
    "gamma0 v/|v|": r"\gamma_0 \mathbf{v}/|\mathbf{v}|",
    "eta0 52/81 int S^T mu v/(|v|^2 + v0^2)^(1/2) dp": (
        r"\eta_0 \tfrac{52}{81} \int \mathbf{S}^T \mu \mathbf{v}/(|\mathbf{v}|^2 + v_0^2)^{1/2} dp"
    ),
    "2 eta0 b/(pi omega^2 A)": r"2 \eta_0 b/(\pi \omega^2 A)",
    "b = 52/81 int mu |phi| dp / phi^T M phi": rf"b = \tfrac{{52}}{{81}} \int \mu |\varphi| dp/{MODAL_MASS}",
    "eta0 (52/81)/v0": r"\tfrac{52}{81} \eta_0/v_0",
    "s^3 (10 - 15 s + 6 s^2)": r"s^3 (10 - 15 s + 6 s^2)",
    "C = alpha M + beta K": r"\mathbf{C} = \alpha \mathbf{M} + \beta \mathbf{K}",
    "alpha M e_t": r"\alpha \mathbf{M} \dot{\mathbf{e}}",
    "Q_damp": r"\mathbf{Q}^\mathrm{damp}",
    "C = M Phi diag(2 zeta omega) Phi^T M": (
        r"\mathbf{C} = \mathbf{M} \boldsymbol{\Phi} \mathrm{diag}(2 \zeta \omega) \boldsymbol{\Phi}^T \mathbf{M}"
    ),
    "B = M Phi": r"\mathbf{B} = \mathbf{M} \boldsymbol{\Phi}",
    "C = B diag(2 zeta omega) B^T": r"\mathbf{C} = \mathbf{B} \mathrm{diag}(2 \zeta \omega) \mathbf{B}^T",
    "eta1 = 2 zeta omega": r"\eta_1 = 2 \zeta \omega",
    "2 zeta omega": r"2 \zeta \omega",
    "phi^T C phi / (2 omega)": r"\boldsymbol{\varphi}^T \mathbf{C} \boldsymbol{\varphi}/(2 \omega)",
    "xi/(2 omega)": r"\xi/(2 \omega)",
    "phi^T M (e - e_rest)": r"\boldsymbol{\varphi}^T \mathbf{M} (\mathbf{e} - \mathbf{e}_\mathrm{rest})",
    "sin(omega t)": r"\sin \omega t",
    "Im sum X_k exp(i k omega t), k = 0, 1, ...": (r"\operatorname{Im} \sum X_k \exp(i k \omega t), k = 0, 1, \ldots"),
    "A sin(omega t + phi)": r"A \sin(\omega t + \varphi)",
    "A exp(i phi)": r"A \exp(i \varphi)",
    "Y exp(i phi)": r"Y \exp(i \varphi)",
    "gamma1 v + gamma2 |v| v": r"\gamma_1 \mathbf{v} + \gamma_2 |\mathbf{v}| \mathbf{v}",
    "eta1 int S^T mu v dp + eta2 1183/876 int S^T mu |v| v dp": (
        r"\eta_1 \int \mathbf{S}^T \mu \mathbf{v} dp"
        r" + \eta_2 \tfrac{1183}{876} \int \mathbf{S}^T \mu |\mathbf{v}| \mathbf{v} dp"
    ),
    "b eta1/(2 omega) + 4 eta2 c A/(3 pi)": r"b \eta_1/(2 \omega) + 4 \eta_2 c A/(3 \pi)",
    "c = 1183/876 int mu |phi|^3 dp / phi^T M phi": (
        rf"c = \tfrac{{1183}}{{876}} \int \mu |\varphi|^3 dp/{MODAL_MASS}"
    ),
    "b = int mu phi^2 dp / phi^T M phi": rf"b = \int \mu \varphi^2 dp/{MODAL_MASS}",
    "zeta = alpha/(2 omega) + beta phi^T K phi/(2 omega)": (
        r"\zeta = \alpha/(2 \omega) + \beta \boldsymbol{\varphi}^T \mathbf{K} \boldsymbol{\varphi}/(2 \omega)"
    ),
    "phi^T K phi is omega^2": r"\boldsymbol{\varphi}^T \mathbf{K} \boldsymbol{\varphi} = \omega^2",
    "v/sqrt(v^2 + v0^2)": r"v/\sqrt{v^2 + v_0^2}",
    "A = b h": r"A = b h",
    "I = b h^3 / 12": r"I = b h^3/12",
    "(a.b)^2 / (a.a b.b)": (
        r"(\mathbf{a} \cdot \mathbf{b})^2/(\mathbf{a} \cdot \mathbf{a} \; \mathbf{b} \cdot \mathbf{b})"
    ),
    "f_0 (1 + k A^2)": r"f_0 (1 + k A^2)",
    "f_0 (1 + k A)": r"f_0 (1 + k A)",
    "f_0 (1 + k ln(1 + A/A_s))": r"f_0 (1 + k \ln(1 + A/A_s))",
    "f (1 + k A^2)": r"f (1 + k A^2)",
    "f (1 + k A^q)": r"f (1 + k A^q)",
    "f (1 + k A)": r"f (1 + k A)",
    "f (1 + k ln(1 + A/A_s))": r"f (1 + k \ln(1 + A/A_s))",
    "d + v (1 - exp(-k t))/k": r"d + v (1 - e^{-k t})/k",
    "d + v t": r"d + v t",
    "eta_p |v|^p": r"\eta_p |v|^p",
    "1 - (standard error/std of the prior)^2": r"1 - (\text{standard error}/\text{std of the prior})^2",
    "R B diag(d) B^T R^T e_t": (
        r"\mathbf{R} \mathbf{B} \mathrm{diag}(\mathbf{d}) \mathbf{B}^T \mathbf{R}^T \dot{\mathbf{e}}"
    ),
    "(e_t, P) -> int S^T mu |v| v dp": (
        r"(\dot{\mathbf{e}}, \mathbf{P}) \to \int \mathbf{S}^T \mu |\mathbf{v}| \mathbf{v} dp"
    ),
    "(e_t, P, v0) -> int S^T mu v/(|v|^2 + v0^2)^(1/2) dp": (
        r"(\dot{\mathbf{e}}, \mathbf{P}, v_0) \to"
        r" \int \mathbf{S}^T \mu \mathbf{v}/(|\mathbf{v}|^2 + v_0^2)^{1/2} dp"
    ),
    "(e_tt, P) -> int S^T mu r_tt dp": (
        r"(\ddot{\mathbf{e}}, \mathbf{P}) \to \int \mathbf{S}^T \mu \ddot{\mathbf{r}} dp"
    ),
    "phi": r"\varphi",
    "-zeta omega + i omega (1 - zeta^2)^1/2": r"-\zeta \omega + i \omega (1 - \zeta^2)^{1/2}",
}


def pattern(plain: str) -> str:
    """Return the regular expression of a formula in a docstring, perhaps in backticks, and broken over lines."""
    return r"\s+".join(map(re.escape, plain.split()))


PLAIN = re.compile(
    rf"(?P<ticks>(?:``)?)(?<![\w.])(?P<plain>{'|'.join(map(pattern, sorted(FORMULAS, key=len, reverse=True)))})(?!\w)"
    r"(?P=ticks)"
)


def typeset(docstring: str) -> str:
    """Return a docstring with its formulas as roles of reStructuredText; its examples stay as they are."""
    text, *examples = re.split(r"(?=\n *Examples\n)", docstring, maxsplit=1)
    return "".join([PLAIN.sub(lambda found: rf":math:`{FORMULAS[' '.join(found['plain'].split())]}`", text), *examples])


def typeset_lines(app: Any, what: str, name: str, obj: object, options: Any, lines: list[str]) -> None:
    """Typeset the lines of a docstring, as a handler of autodoc."""
    lines[:] = typeset("\n".join(lines)).split("\n")
