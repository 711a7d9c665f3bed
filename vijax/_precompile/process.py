"""The process that makes programs, seen from the one that has started it."""

import json
import os
import subprocess
import sys
import tempfile
import warnings
from threading import Thread
from typing import Any

from .._jax.users_line import users_line

# Niceness, by which all others go first; it must be set before JAX starts threads.
_NICENESS = 10
_START = f"""
import os
if hasattr(os, "nice"):
    os.nice({_NICENESS})
from {__package__}.worker import main
main()
"""


class Precompilation:
    """A process that makes programs and ends by itself, also after the process that started it.

    Attributes:
        calls: names of the calls for which it makes them.
    """

    def __init__(self, calls: tuple[str, ...], shipment: bytes):
        self.calls = calls
        self._report: bytes = b""
        with tempfile.TemporaryFile() as file:  # it is complete even if this process ends now
            file.write(shipment)
            file.seek(0)
            self._process = subprocess.Popen(
                [sys.executable, "-c", _START],
                stdin=file,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                # Modules are looked for where this process does.
                env=os.environ | {"PYTHONPATH": os.pathsep.join(path or os.getcwd() for path in sys.path)},
                start_new_session=True,  # Ctrl-C in a terminal is not for it
            )
        # The thread collects the process when that has ended.
        self._thread = Thread(target=self._collect, daemon=True)
        self._thread.start()

    def _collect(self) -> None:
        self._report, _ = self._process.communicate()

    @property
    def is_running(self) -> bool:
        """True while the process makes programs."""
        return self._thread.is_alive()

    def wait(self) -> None:
        """Wait until all programs are made, and warn of calls for which they could not be.

        Raises:
            RuntimeError: if the process was ended from outside, or cannot import what the machine consists of. What it
                has made is kept.
        """
        while self._thread.is_alive():
            self._thread.join(0.5)  # lets Ctrl-C through
        for call, reason in _read(self._report, self._process.returncode).items():
            warnings.warn(
                f"`vx.precompile` has not made all programs of `{call}`: {reason}", stacklevel=users_line()
            )

    def stop(self) -> None:
        """End the process; what it has made is kept."""
        self._process.terminate()
        self._thread.join()

    def __repr__(self) -> str:
        state = "running" if self.is_running else "ended"
        return f"Precompilation({', '.join(self.calls)}; {state})"


def _read(output: bytes, code: int | None) -> dict[str, str]:
    """For each call whose programs are not complete, why.

    Raises:
        RuntimeError: if the process did not come to its end.
    """
    report: dict[str, Any]
    try:
        report = json.loads(output.splitlines()[-1])
    except (ValueError, IndexError):
        report = {"error": f"it was ended from outside, with code {code}"}
    if "error" in report:
        raise RuntimeError(f"The process of `vx.precompile` has not made all programs: {report['error']}.")
    return report["failed"]
