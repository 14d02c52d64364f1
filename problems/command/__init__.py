"""The subcommands of ``ancf-casadi``; those that share a step share a file.

``add_NAME`` adds the options of the subcommand NAME to its parser, and ``run_NAME`` returns its ``Output``;
``output`` holds what they share, and ``record_options`` what those that read records share.
"""
