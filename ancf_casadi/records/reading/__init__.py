"""Readers of measured data, one file per format; each returns the ``Recording`` of a file.

``formats`` recognises the format and chooses the reader.  ``text`` has the reader of tables in plain text.  The other
formats are read by their libraries, which are imported on demand (``libraries``).  A file is data: nothing in it is
executed or unpickled, and no reader allocates more than the file can hold, whatever its header declares.  A file that
is damaged, or whose library is missing, raises an ``InputError`` that says so.
"""
