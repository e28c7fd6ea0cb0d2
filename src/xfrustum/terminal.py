"""Messages of the program on standard error, and escaping of untrusted text for a terminal."""

import re
import sys
from contextlib import suppress

_UNPRINTABLE = re.compile(
    "["
    r"\x00-\x08\x0b-\x1f\x7f-\x9f"  # control characters except tab and line feed
    # Characters that are invisible, or that change the direction of writing:
    r"\u00ad\u061c\u180e\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff\ufff9-\ufffb"
    r"\U000e0000-\U000e0fff"
    r"\ud800-\udfff"  # surrogates, among them bytes of names that are not UTF-8
    "]"
)

#: Code points with which Python replaces the bytes 0x80 to 0xff of a file name that is not UTF-8.
_ESCAPED_BYTES = range(0xDC80, 0xDD00)


#: Largest number of characters of a message; a longer message loses the middles of long words
#: first, then its own middle.
MAX_MESSAGE = 500


def say(message: str) -> None:
    """Write one line of the program to standard error; errors of that stream are ignored."""
    line = one_line(f"xfrustum: {message}")
    if len(line) > MAX_MESSAGE:
        line = re.sub(
            r"\S{101,}", lambda long: f"{long[0][:48]}..{long[0][-48:]}", line
        )  # mostly file names
        half = (MAX_MESSAGE - len(" .. ")) // 2
        line = line if len(line) <= MAX_MESSAGE else f"{line[:half]} .. {line[-half:]}"
    # sys.stderr may be None.
    with suppress(OSError, ValueError, AttributeError):
        sys.stderr.write(f"{line}\n")
        sys.stderr.flush()


def printable(text: str) -> str:
    r"""Return text whose control characters are escaped, such as `\x1b`; tabs and line feeds stay.

    Characters that are invisible or that change the direction of writing are escaped as well, and
    bytes of file names that are not UTF-8, as `\xff`.
    """
    return _UNPRINTABLE.sub(_escaped, text)


def one_line(text: str) -> str:
    """Return printable text on one line: line feeds and runs of spaces become one space."""
    return printable(" ".join(text.split()))


def _escaped(match: re.Match[str]) -> str:
    code = ord(match[0])
    if code in _ESCAPED_BYTES:
        code -= _ESCAPED_BYTES.start - 0x80
    return (
        f"\\x{code:02x}"
        if code < 0x100
        else f"\\u{code:04x}"
        if code < 0x10000
        else f"\\U{code:08x}"
    )
