"""Accuracy of the motions of ready-made machines, compared with closed forms."""

# Rounding of 1e-16 in some hundred steps.
EXACT = 2e-14
# The same, magnified by the multipliers of an orbit over the periods simulated.
ORBIT = 5e-13
