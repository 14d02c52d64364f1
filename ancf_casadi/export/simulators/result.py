"""The account of a beam in another program: its settings, and how well they represent it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ancf_casadi.support.arrays import Array
from ancf_casadi.support.tables import Displayed, Table


@dataclass(frozen=True)
class ExportedBeam(Displayed):
    """A beam as it was written for another program: its settings, and how it vibrates there and here.

    The values of the other program follow from the eigenvalues of its discretised beam in one step of its integrator.

    Parameters
    ----------
    format : str
        The program: exudyn, mujoco, newton or pyelastica.
    segments : int
        Number of segments or elements.
    step : float
        Time step, s.
    amplitude : float
        Tip amplitude in mode 1 to which damping ratios refer, m; in other modes, the tip has the same speed.
    frequencies, reached_frequencies : array (3,)
        First natural frequencies here and in the program, Hz.
    damping_ratios, reached_damping_ratios : array (3,)
        Damping ratios of these modes here and in the program.
    warnings : tuple of str
        Sentences on what the program cannot represent.

    Examples
    --------
    >>> from ancf_casadi import Beam, Model, RayleighDamping
    >>> from ancf_casadi.export import write_mujoco
    >>> beam = Beam.uniform(length=0.5, width=5e-3, thickness=0.5e-3,
    ...                     density=8000.0, elastic_modulus=210e9, elements=8)
    >>> found = write_mujoco(Model(beam), "beam.xml", damping=RayleighDamping(alpha=0.2, beta=1e-4))
    >>> print(found.report())
    Beam for mujoco
    -------------------------------------------------------------------------
    mode     f_Hz  f_mujoco_Hz  error_%  damping_ratio  ratio_mujoco  error_%
    -------------------------------------------------------------------------
       1  1.87613      1.87617    0.002     0.00894211    0.00894131   -0.009
       2  10.5792      10.5566   -0.214     0.00470057    0.00468452   -0.341
       3  29.2757      29.0791   -0.671     0.00960837    0.00952985   -0.817
      12 segments, steps of 0.0005 s, tip amplitude 0.01 m in mode 1
    """

    format: str
    segments: int
    step: float
    amplitude: float
    frequencies: Array
    reached_frequencies: Array
    damping_ratios: Array
    reached_damping_ratios: Array
    warnings: tuple[str, ...] = ()

    def table(self) -> Table:
        """Return frequencies and damping ratios here and in the program."""
        columns = ("mode", "f_Hz", f"f_{self.format}_Hz", "error_%", "damping_ratio", f"ratio_{self.format}", "error_%")
        rows = []
        for k, (f, reached, zeta, met) in enumerate(
            zip(*(own.tolist() for own in self._compared), strict=True), start=1
        ):
            errors = (round(100 * (now / own - 1), 3) if own else None for own, now in ((f, reached), (zeta, met)))
            rows.append((k, f, reached, next(errors), zeta, met, next(errors)))
        note = f"{self.segments} segments, steps of {self.step:g} s, tip amplitude {self.amplitude:.4g} m in mode 1"
        return Table(f"beam_{self.format}", f"Beam for {self.format}", columns, rows, (note,))

    def report(self) -> str:
        """Return the table and the warnings as text."""
        return "\n".join([self.table().text(), *(f"  note: {one}" for one in self.warnings)])

    def to_dict(self) -> dict[str, Any]:
        """Return the settings, and the frequencies and damping ratios here and in the program, as plain data."""
        return {
            "kind": "exported beam",
            "format": self.format,
            "segments": self.segments,
            "step_s": self.step,
            "amplitude_m": self.amplitude,
            "frequencies_hz": self.frequencies.tolist(),
            "reached_frequencies_hz": self.reached_frequencies.tolist(),
            "damping_ratios": self.damping_ratios.tolist(),
            "reached_damping_ratios": self.reached_damping_ratios.tolist(),
            "warnings": list(self.warnings),
        }

    @property
    def _compared(self) -> tuple[Array, Array, Array, Array]:
        return self.frequencies, self.reached_frequencies, self.damping_ratios, self.reached_damping_ratios

    def _summary(self) -> str:
        worst = 100 * abs(self.reached_frequencies / self.frequencies - 1.0).max()
        return f"{self.format}, {self.segments} segments, steps of {self.step:g} s, frequencies within {worst:.2g} %"

    def _repr_html_(self) -> str:
        """Return the table and the warnings for a notebook."""
        return self.table()._repr_html_() + "".join(f"<p>note: {one}</p>" for one in self.warnings)
