"""How exact the motions of ready-made machines are, beside closed forms."""

# Rounding of 1e-16 in some hundred steps.
EXACT = 2e-14
# The same, magnified by the multipliers of an orbit over the periods it is followed.
ORBIT = 5e-13
