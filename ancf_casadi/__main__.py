"""``python -m ancf_casadi``: the command ``ancf-casadi``, of the package ``problems``."""

import runpy

runpy.run_module("problems.cli", run_name="__main__", alter_sys=True)
