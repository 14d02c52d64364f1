"""``ancf-casadi init``: a commented TOML file that runs as it is."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.files import check_file, write_file
from problems.command.output import Output, json_text

STUDY = """\
# A beam, its damping, the motion of its clamp, and records of it.  All numbers are in SI units.
#
#   ancf-casadi modes {name}                        natural frequencies and shapes
#   ancf-casadi match {name}                        nearest beam with measured frequencies
#   ancf-casadi simulate {name} --out motion.csv    large motion
#   ancf-casadi response {name}                     steady vibration over frequency
#   ancf-casadi fit {name}                          damping from records, here from that motion
#   ancf-casadi study {name}                        all of it as one document, results/report.html; after simulate
#
# A line that begins with # is a comment; remove the # to use it.  Each command has a --help.

[study]                     # for study
title = "A hanging strip of spring steel"

[beam]                      # a hanging strip of spring steel
length = 0.5                # m
width = 5e-3                # m, out of the plane of motion; a list gives one value per element
thickness = 0.5e-3          # m
density = 8000.0            # kg/m^3
elastic_modulus = 210e9     # Pa
elements = 8
axis = [0.0, -1.0]          # direction of the beam at the clamp; x to the right, y up
gravity = [0.0, -9.81]      # m/s^2
# tip_mass = 1e-3           # kg
# clamp_stiffness = 5.0     # N m/rad; rigid if not given

[match]                     # for match
targets = [1.85, 10.19, 26.84]    # Hz, measured, in ascending order
bounds = 0.10               # properties may change by 10 %

[[damping]]                 # several tables [[damping]] add up
law = "modal"
ratios = [0.005, 0.003]     # damping ratio of each mode

[[damping]]
law = "quadratic"           # air drag
eta2 = 0.11                 # 1/m

# [[damping]]
# law = "friction"
# eta0 = 0.01               # m/s^2

# [[damping]]
# law = "rayleigh"
# alpha = 0.01              # 1/s
# beta = 1e-5               # s

[base]                      # motion of the clamp: shaken at the first frequency, then stopped
amplitude = 2e-3            # m
frequency = 1.876           # Hz; frequencies = [1.0, 3.0] sweeps from one to the other
stop = 1.0                  # s; the clamp stops at the next instant of zero velocity
# ramp = 10                 # cycles in which the amplitude grows, so that a fast drive moves no low mode
# or a measured motion: file = "clamp.csv" and x = "clamp_x" or the number of a column

# [release]                 # the beam is held by a load at the tip and released at time 0
# tip_force = [5e-3, 0.0]   # N

[response]                  # for response: steady vibration through the resonance of mode 2
frequencies = [10.2, 10.9]  # Hz
base_amplitudes = [5e-5, 2e-4]    # m, one curve each; or tip_forces, N
modes = 5                   # of the reduced model; model = "full" takes the whole beam

# [load]                    # force at the tip over time
# frequency = 1.876         # Hz; or time = [0.0, 0.1] and force = [[1e-3, 0.0], [1e-3, 0.0]]: a short push
# force = [1e-3, 0.0]       # N

[simulation]                # for simulate
duration = 2.0              # s
sample_rate = 200.0         # 1/s

[markers]                   # points in the output beside the tip: arc length from the clamp, m
middle = 0.25

[[records]]                 # for fit and compare-laws: one table per measured motion
file = "motion.csv"         # any file that inspect can read; here the output of simulate
sensor = "position"         # or "displacement", "velocity", "acceleration", "slope", "strain"
channels = [                # one per sensor; point = arc length in m, the tip if not given
    {{column = "tip_x_m", direction = [1.0, 0.0]}},
    {{column = "tip_y_m", direction = [0.0, 1.0]}},
]

# [[decays]]                # for study: one table per measured free decay, mode by mode
# file = "decay.csv"        # any file that inspect can read
# column = "x"              # name or number
# unit = "mm"

[fit]                       # unknowns beside the parameters of the laws, whose values above are guesses
# fixed = ["ratio1"]        # parameters to keep
# unknowns = ["elastic_modulus", "base_amplitude"]

# [[frequencies]]           # for fit: measured natural frequencies, also of the beam with an added mass
# frequencies = [1.88, 11.8]      # Hz
# std = [0.01, 0.05]        # Hz
# tip_mass = 1e-3           # kg

# [[statics]]               # for fit: the beam at rest under loads
# loads = [{{mass = 1e-3}}, {{mass = 2e-3}}]    # kg; or force = [1e-3, 0.0], N; point = arc length, m
# axis = [1.0, 0.0]         # the beam was held level
# values = [0.0295, 0.0559] # m, displacement of the tip under each load
# direction = [0.0, -1.0]
"""


def add_init(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.set_defaults(run=_run)
    parser.add_argument(
        "file",
        nargs="?",
        type=Path,
        default=Path("study.toml"),
        metavar="STUDY.toml",
        help="file to write, which must not exist yet (default: study.toml)",
    )


def _run(options: argparse.Namespace) -> Output:
    path: Path = options.file
    if path.suffix.lower() != ".toml":
        raise InputError("must end in .toml", str(path))
    if path.exists() or path.is_symlink():
        raise InputError("exists already; choose another name", str(path))
    check_file(path)
    name = path.name if path.name.isprintable() else "study.toml"  # in comments, which a line break would end
    write = partial(write_file, path, STUDY.format(name=name))
    if options.json:
        return Output(json_text({"file": str(path)}), [write])
    return Output("", [write], f"wrote {path}; try: ancf-casadi simulate {path} --out motion.csv")
