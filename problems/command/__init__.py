"""The subcommands of ``ancf-casadi``, one file each, and what they share.

``add_options`` of each file adds the options of the subcommand to its parser, and ``run`` returns its ``Output``;
``output`` holds what they share, and ``record_options`` what those that read records share.
"""
