"""Drawings and films of machines, the explorer and the command line; `vx.plot`, `vx.explore` and `vijax` lead here."""
