"""The subcommands of ``ancf-casadi``, one file each, and the files that they read.

Each subcommand adds its options to the parser and returns an ``Output``; ``output`` holds what they share.
``study_file`` reads TOML files and documents, and ``exporting`` calls the exports.
"""
