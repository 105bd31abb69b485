"""The command ``simtrue``, the same as that of the Rust program."""

import signal
import sys

from . import _simtrue


def main() -> int:
    """Runs the command line of this process; the exit code."""
    # Ctrl-C goes to the command: Python's own handler would wait for its end.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    return _simtrue.command(["simtrue", *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(main())
