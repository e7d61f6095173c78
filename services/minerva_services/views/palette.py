"""Colours and marks that 2D views share: paper, ink, interaction and headings."""

PAPER = "#f4f0e6"
PANEL = "#fbfaf6"
BORDER = "#d3ccbb"
INK = "#2f3640"
FAINT = "#857e6e"
OUTLINE = "#1d232b"
DARK = "#5b6573"
CHOSEN = "#1f7a8c"
BEAM = "#e8963c"

HEADING_MARK = ((0.78, 0.0), (0.7, 140.0), (0.28, 180.0), (0.7, -140.0))
"""The mark on discs with a heading: distances in radii, and directions in degrees."""
