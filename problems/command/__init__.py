"""The subcommands of ``ancf-casadi``, one file each, and what they share.

Each subcommand adds its options to the parser and returns an ``Output``; ``output`` holds what they share.  ``tables``
reads TOML files, ``record_options`` the files of records, and ``exporting`` calls the exports.
"""
