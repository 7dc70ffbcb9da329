"""What the radii are held against: hypotheses, and the one posterior over them."""
