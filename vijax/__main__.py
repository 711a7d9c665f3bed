"""`python -m vijax`: sweeps, pictures and the explorer without a program of one's own."""

import sys

from .studio.command_line.main import main

if __name__ == "__main__":
    sys.exit(main())
