"""Main function of the process that makes programs."""

import contextlib
import json
import sys

from .rehearsals import rehearse
from .shipment import unpacked_shipment

# Seconds of CPU time after which the process is ended, if a call does not end by itself.
_LIMIT = 3600


def main() -> None:
    """Make the programs of a shipment, and report what could not be made."""
    _limit_time()
    try:
        system, calls = unpacked_shipment(sys.stdin.buffer.read())
        report = {"failed": rehearse(system, calls)}
    except Exception as error:  # whatever a module of the user raises at its import
        report = {"error": f"{type(error).__name__}: {error}"}
    with contextlib.suppress(OSError):  # the process that would read it has ended
        sys.stdout.write(f"\n{json.dumps(report)}\n")
        sys.stdout.flush()


def _limit_time() -> None:
    try:
        import resource
    except ImportError:  # Windows
        return
    _, hard = resource.getrlimit(resource.RLIMIT_CPU)
    resource.setrlimit(
        resource.RLIMIT_CPU, (_LIMIT if hard == resource.RLIM_INFINITY else min(_LIMIT, hard), hard)
    )
