"""The command line as a process: from arguments to an exit status, for all exceptions and signals.

Exit status: 0 done, 1 a stated limit was exceeded, 2 bad input, 70 an unexpected error, 130 and 143
ended by a signal; statuses above 1 print the reason in one line on standard error. Nothing heavy is
imported before signal handlers are installed.
"""

import errno
import faulthandler
import logging
import os
import signal
import sys
import warnings
from collections.abc import Sequence
from typing import Any

from xfrustum import process
from xfrustum.process import say

#: Exit statuses for a mistake of the user, and for an error of the program (EX_SOFTWARE).
BAD_INPUT, UNEXPECTED_ERROR = 2, 70

TRACEBACK_OPTION = "--traceback"

_FREE, _PERMISSION = (
    "free some space or choose another place",
    "choose another place, or ask for permission",
)
#: Advice to the user by error number of the operating system; other errors are unexpected.
ADVICE = {
    errno.ENAMETOOLONG: "give a shorter name",
    errno.ENOSPC: _FREE,
    errno.EDQUOT: _FREE,
    errno.EFBIG: "choose a place where files may be larger",
    errno.EROFS: "choose another place",
    errno.EACCES: _PERMISSION,
    errno.EPERM: _PERMISSION,
    errno.ELOOP: "mend the symbolic links",
    errno.EMFILE: "raise the limit on open files (ulimit -n)",
}


def run() -> int:
    """Run the command line of this process and return its exit status."""
    for descriptor in (0, 1, 2):
        try:
            os.fstat(descriptor)
        except OSError:  # closed: libraries would write to the next file, which gets this number
            os.open(os.devnull, os.O_RDWR)
    # Write to the true standard error, even if a library has replaced its descriptor. Child
    # processes inherit this. A crash in native code, such as a driver, then still prints a stack.
    faulthandler.enable(os.dup(2))
    os.environ.setdefault("PYTHONFAULTHANDLER", "1")
    streams = [stream for stream in (sys.stdout, sys.stderr) if stream is not None]
    for stream in streams:
        # File names may hold surrogates, which strict encoders refuse.
        stream.reconfigure(encoding="utf-8", errors="backslashreplace")  # type: ignore[union-attr]
    # Read the option before click runs, because mere imports may log or warn.
    if TRACEBACK_OPTION not in sys.argv[1:2]:
        logging.disable()
        if not sys.warnoptions:
            warnings.simplefilter("ignore")
            # The only Python warning for users; it is selected by message, because its class would
            # load OpenGL.
            warnings.filterwarnings("once", message=".* draws in software")
            warnings.showwarning = _show_warning
    status = main()
    for stream in streams:
        try:
            stream.flush()
        # drop the output that cannot be written, because Python would report it at exit
        except OSError:
            # The interpreter flushes once more at exit; the null device accepts the rest.
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
    if process.received is not None:
        # Exit at once: threads may be running, and interrupted libraries may be in any state.
        os._exit(status)
    return status


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command and return its exit status; None selects the arguments of this process."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    try:
        with process.obeyed(ignored_afterwards=arguments is None):
            from xfrustum.cli.app import invoke

            status = invoke(words)
    except BaseException as error:
        # After a signal, a library that was interrupted may raise any exception.
        status = 0 if process.received else _status_of(error, shown=TRACEBACK_OPTION in words[:1])
    if process.received is not None:
        say(process.WORDS[process.received] + process.advice)
        # Shells report a process ended by signal N as 128 + N.
        status = 128 + process.received
    return status


def _show_warning(message: Warning | str, *_: Any, **__: Any) -> None:
    say(f"warning: {message}")


def _status_of(error: BaseException, *, shown: bool) -> int:
    """Print an error in one line and return the exit status."""
    import click

    # Look up the class instead of importing it: if it is not loaded, nothing has raised it.
    errors = sys.modules.get("xfrustum.scenes.arguments")
    if isinstance(error, click.ClickException):
        say(f"error: {error.format_message()}")
    elif errors is not None and isinstance(error, errors.InputError):
        say(f"error: {error}")
    elif isinstance(error, BrokenPipeError):  # a reader that stops reading is not an error
        return 0
    elif isinstance(error, OSError) and error.errno in ADVICE:
        # All files have names here: an error without a file name is from standard output.
        place = "standard output" if error.filename is None else os.fsdecode(error.filename)
        say(f"error: {place}: {os.strerror(error.errno)}; {ADVICE[error.errno]}")
    elif isinstance(error, KeyboardInterrupt | click.Abort):  # the calling program handles signals
        say(process.WORDS[signal.SIGINT] + process.advice)
        return 128 + signal.SIGINT
    else:
        _report_unexpected(error, shown=shown)
        return UNEXPECTED_ERROR
    return BAD_INPUT


def _report_unexpected(error: BaseException, *, shown: bool) -> None:
    """Print in one line that the program failed, and the file of its traceback."""
    import tempfile
    import traceback

    text = "".join(traceback.format_exception(error))
    # Messages of libraries may be pages long; the file has the whole text.
    reason = str(error)[:200] or ("out of memory" if isinstance(error, MemoryError) else "")
    what = f"unexpected error: {type(error).__name__}{reason and f': {reason}'}"
    if shown:
        if sys.stderr is not None:
            sys.stderr.write(text)
        say(what)
        return
    try:
        # A unique name keeps tracebacks of concurrent processes apart.
        descriptor, name = tempfile.mkstemp(prefix="xfrustum-traceback-", suffix=".txt")
        with os.fdopen(descriptor, "w", encoding="utf-8", errors="backslashreplace") as file:
            file.write(text)
        say(f"{what}; its traceback is in {name}")
    except OSError:
        say(f"{what}; its traceback could not be written: run `xfrustum --traceback ..` to see it")
