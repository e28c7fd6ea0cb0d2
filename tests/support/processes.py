"""Child processes of tests, which answer signals however the tests themselves were started."""

from __future__ import annotations

import signal


def signals_by_default() -> None:
    """Undo what a shell does to jobs in the background, which ignore Ctrl-C, and what a parent holds back."""
    stops = (signal.SIGINT, signal.SIGTERM)
    for stop in stops:
        signal.signal(stop, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, stops)
