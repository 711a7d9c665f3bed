"""`python -m vijax`: sweeps, pictures and the explorer from the command line."""

import sys

from .studio.command_line.main import main

if __name__ == "__main__":
    sys.exit(main())
