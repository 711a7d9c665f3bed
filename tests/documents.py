"""The Python code of a document, for whoever runs or checks it: `python tests/documents.py FILE` prints it."""

import re
import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent


def python_of(document: str) -> str:
    """The Python blocks of a document, one after the other."""
    return "\n".join(re.findall(r"^```python\n(.*?)^```", (ROOT / document).read_text(), re.M | re.S))


if __name__ == "__main__":
    sys.stdout.write(python_of(sys.argv[1]))
