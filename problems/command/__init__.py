"""The subcommands of ``ancf-casadi``, one file each, and what they share.

A function ``add_...`` adds the options of each subcommand to its parser; the subcommand returns an ``Output``, and
``output`` holds what they share, and ``record_options`` what those that read records share.
"""
