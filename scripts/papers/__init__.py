"""Machines and printed numbers of others, a file a source; `published.py` runs them.

Each file has `values()`, the printed numbers beside those found, and `draw(axes)`, a picture of the motion.
"""
