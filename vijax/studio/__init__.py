"""Drawings and films of machines, the explorer and the command line, behind `vx.plot`, `vx.explore` and `vijax`."""
