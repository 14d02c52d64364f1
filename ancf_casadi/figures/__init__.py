"""All figures of results, each made without a display, as a matplotlib ``Figure``.

Results name the function that draws them (``support.figures.drawing``), so that Matplotlib is imported with the first
figure only.  ``beams`` draws the beam itself, and ``symbols`` its supports and loads; ``files`` makes image files.
"""
