"""The subcommands of ``ancf-casadi``, one file each, and what they share.

A function ``add_...`` adds the options of each subcommand to its parser; the subcommand returns an ``Output``, and
``output`` holds what they share.  ``tables`` reads TOML files, ``record_options`` the files of records, and
``exporting`` calls the exports.
"""
