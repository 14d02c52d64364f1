"""The tables of TOML files, one file per kind of table, and the files of each command (``study_file``).

``study`` holds a file that was read, and the checks that all tables share.  The keys of a table are strict, and each
error begins with ``FILE: [table]: key``.  Names of other files are relative to the folder of the TOML file.
"""
