"""Tables in plain text: comma, semicolon, tab or spaces; with or without names, units and metadata.

``reader`` combines the steps: blocks of lines, the ``dialect`` of the table, its ``header`` and its ``cells``.
"""
