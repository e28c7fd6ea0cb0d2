"""The program `xfrustum`, also as `python -m xfrustum`: the process around `xfrustum.cli.main.main`.

Signals are taken over before anything else is imported, then the standard streams.
"""

from __future__ import annotations

import _signal  # type: ignore[import-not-found]  # nobody has described it to mypy
import sys

# Signals wait until there are handlers. `_signal` is the part of `signal` that is built into Python.
ENDING_SIGNALS = (_signal.SIGINT, _signal.SIGTERM)
_signal.pthread_sigmask(_signal.SIG_BLOCK, ENDING_SIGNALS)

from xfrustum.cli import termination as cli_termination  # noqa: E402

TRACEBACK_OPTION = "--traceback"

UNWRITABLE_OUTPUT = 2
"""Exit status where standard output cannot be written: that of bad input, for the user can mend it."""


def run() -> int:
    """Run the command line of this process and return its exit status."""
    termination = cli_termination.of_process()
    _signal.pthread_sigmask(_signal.SIG_UNBLOCK, ENDING_SIGNALS)
    from xfrustum.cli import streams as cli_streams  # noqa: PLC0415 - after the signals are taken over

    shown = TRACEBACK_OPTION in sys.argv[1:2]
    streams = cli_streams.of_process(words_of_libraries=shown)
    try:
        from xfrustum.cli.main import main  # noqa: PLC0415 - likewise
        from xfrustum.cli.process import keep_freed_memory, share_python_often  # noqa: PLC0415 - likewise

        keep_freed_memory()
        share_python_often()
        status = main()
    except BaseException as error:  # such as too little memory to load the program
        from xfrustum.cli.failure import report_unexpected  # noqa: PLC0415 - only here

        status = report_unexpected(error, shown=shown)
    failure = streams.failure_of_output()
    if failure is not None and termination.received is None:
        cli_streams.say(
            f"error: standard output: cannot be written ({failure}); send it to a place that has room"
        )
        status = UNWRITABLE_OUTPUT
    # The work is done. A signal must not raise an exception while Python and libraries shut down.
    termination.ignore()
    if termination.received is not None:
        _leave(status)
    return status


def _leave(status: int) -> None:
    """End the process at once: interrupted libraries may be in any state, and threads still at work."""
    import os  # noqa: PLC0415 - only here

    from xfrustum.terminal import messages  # noqa: PLC0415 - likewise

    sys.stdout.flush()
    messages().flush()
    os._exit(status)


if __name__ == "__main__":
    sys.exit(run())
