"""Readers of measured data, one file per format; each returns the ``Contents`` of a file.

``formats`` recognises the format.  ``blocks``, ``dialect``, ``header``, ``cells`` and ``stamps`` are the steps of
``text``, the reader of tables in plain text.  The readers of other formats use their libraries, which are imported on
demand; a file is data, and nothing in it is ever executed.
"""
