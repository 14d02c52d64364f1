"""Colours and dashes of figures.

Records are black, what is computed from them is green; both keep their contrast in grey.  The colours of ``SERIES`` can
be told apart by the colour-blind (M. Okabe, K. Ito, 2008), on light and on dark pages; in grey, the dashes and markers
tell them apart.
"""

MEASURED = "#222222"
COMPUTED = "#1b7f5c"

SERIES: tuple[tuple[str, object, str], ...] = (  # colour, dash, marker
    ("#009e73", "-", "o"),
    ("#d55e00", (0, (5, 2)), "s"),
    ("#3a7fc4", (0, (1, 1.2)), "^"),
    ("#b565a7", (0, (6, 1.5, 1, 1.5)), "D"),
    ("#b8860b", (0, (3, 1, 1, 1, 1, 1)), "v"),
)
