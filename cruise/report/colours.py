"""The colours of all pictures: those of M. Okabe and K. Ito, "Color Universal Design", 2008.

Colour-blind people tell them apart.
"""

BLUE, ORANGE, GREEN, RED, GREY = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#777777"
