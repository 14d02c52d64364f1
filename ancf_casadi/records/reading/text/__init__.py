"""Tables in plain text: comma, semicolon, tab or spaces; with or without names, units and metadata.

``reader`` puts the steps together: ``blocks`` of lines, the ``dialect`` of the table, its ``header``, its ``cells``,
and times as ``stamps``.  ``pose`` treats the tracks of markers in videos.
"""
