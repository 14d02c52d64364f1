"""The paper as a program: one module per table or group of figures, in ``reproduce`` in the order of the paper.

A module holds the function of its step, the inputs that it alone needs, and the numbers that the paper prints.
``inputs`` holds what several tables share.  A step computes through ``compute`` with functions of plain data:
``fit_plain`` is ``problems.fit_decay``, ``match_plain`` ``problems.match_frequencies``, and ``run_experiment``
``ancf_casadi.simulate`` with a fit of the decay.
"""
