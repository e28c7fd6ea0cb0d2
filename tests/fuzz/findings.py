"""The findings: outcomes that no input may have."""

import re
from collections.abc import Iterator

from tests.fuzz.child import Outcome

STATUSES = frozenset({0, 1, 2})  # exit statuses that a command may end with when nobody sends it a signal
MEMORY_BYTES = 2 << 30  # memory that no small input may take
PREFIX = b"xfrustum: "  # beginning of every line that a command writes to standard error


BAR = re.compile(rb"[a-z0-9 ]+: +\d+%\|.*")  # A progress bar, which is no message


def findings(outcome: Outcome, outputs: frozenset[str], *, named: bool) -> Iterator[str]:
    """Yield what is wrong with an outcome, one word each.

    `outputs` are what the command may leave if it ends with 0 or 1; under these names where the command line
    is the seed's own (`named`).
    """
    if outcome.hung:
        yield "hang"
    elif outcome.status < 0:
        yield f"signal-{-outcome.status}"
    elif outcome.status not in STATUSES:
        yield f"status-{outcome.status}"
    if b"Traceback" in outcome.errors:
        yield "traceback"
    lines = [
        line for line in re.split(rb"[\r\n]+", outcome.errors) if line.strip() and not BAR.fullmatch(line)
    ]
    if any(not line.startswith(PREFIX) for line in lines) and b"Traceback" not in outcome.errors:
        yield "foreign-words"
    if outcome.status == 2 and sum(line.startswith(PREFIX + b"error") for line in lines) != 1:
        yield "not-one-line"
    if any(byte < 32 for line in lines for byte in line):
        yield "control-characters"
    if outcome.peak_bytes > MEMORY_BYTES:
        yield "memory"
    left = outcome.left - (outputs if outcome.status in (0, 1) else frozenset())
    if any(name.startswith(".") for name in left) or (left and named):
        yield "leftovers"
