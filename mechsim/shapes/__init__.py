"""Which shapes a link is drawn with, from its joints alone: rods, eyes, pins, balls, rails, bearings, gears.

Sizes follow from the size of the mechanism, so that a needle drive of millimetres and a press of
metres look alike. Nothing here is physics: the shapes carry no mass and meet nothing.
"""
