"""Seeded damage, both blind and aware of the structure of texts and binary files."""

import json
import random
import re
import struct
from collections.abc import Callable

NUMBERS = (
    *"0 -0.0 -1 1 2 1e308 -1e308 1e-308 5e-324 1e-40 1e40".split(),  # noqa: SIM905
    *"nan inf -inf 0x10 1_000".split(),  # noqa: SIM905
    *"2147483647 2147483648 -2147483649 4294967296".split(),  # noqa: SIM905
    *"9223372036854775808 1e99999".split(),  # noqa: SIM905
    *("true", "[]", "{}", '"text"', "1" + "0" * 30, "9" * 400, "9" * 5000, "0." + "0" * 400 + "1"),
)
"""Numbers that have broken readers, and texts in their place."""

WORDS = (
    *("", " ", "\0", "\x1b[31m", "\r\n", "\u2028", "..", "../../etc/passwd", "<script>", "%s%n"),
    *("{", "}", "'", '"', "*", "run:1", "s3://x"),
    *("{i!r}", "{i:999999999d}", "{x:.6f}", "{0}", "{i.real}", "{i[0]}", "{nobody}"),
)
"""Texts that have broken readers, and pages that show the texts."""

WHOLE = (0, 1, 2, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF)
"""Whole numbers at the limits of their types."""

COUNTS = (0, 1, 2, 3, 5, 16, 99, 4000, 9999, 65_536, 99_999_999, 10**12, 10**30)
"""Numbers for file names."""

_NUMBER = re.compile(rb"-?\d+\.?\d*(?:[eE][-+]?\d+)?")
_WORD = re.compile(rb"[A-Za-z_][\w.-]*|\"[^\"\n]*\"")
_LARGEST = 1 << 22  # bytes of the largest mutated file: repeated duplication grows without limit

Mutation = Callable[[bytes, random.Random], bytes]


def mutated(data: bytes, chance: random.Random) -> bytes:
    """Return a copy with one to four pieces of damage."""
    for _ in range(chance.choice((1, 1, 1, 2, 2, 3, 4))):
        data = chance.choice(MUTATIONS)(data, chance)[:_LARGEST]
    return data


def mutated_arguments(arguments: tuple[str, ...], chance: random.Random) -> tuple[str, ...]:
    """Return a command line with one to three damaged arguments."""
    damaged = list(arguments)
    for _ in range(chance.choice((1, 1, 2, 3))):
        if not damaged:  # no argument remains: the program without arguments is a valid input too
            break
        at = chance.randrange(1, len(damaged)) if len(damaged) > 1 else 0
        action = chance.randrange(5)
        if action == 0:
            damaged[at] = chance.choice(
                (*NUMBERS, *WORDS, "--", "-", "--help", "--near", "0,0", "1,1;", "*,*")
            )
        elif action == 1:
            del damaged[at]
        elif action == 2:
            damaged.insert(at, damaged[chance.randrange(len(damaged))])
        elif action == 3:
            raw = mutated(damaged[at].encode("utf-8", "surrogateescape"), chance)[:300]
            damaged[at] = raw.replace(b"\0", b"0").decode("utf-8", "surrogateescape")
        else:
            raw = damaged[at].encode("utf-8", "surrogateescape")
            raw = _NUMBER.sub(lambda _: chance.choice(NUMBERS).encode(), raw)
            damaged[at] = raw.decode("utf-8", "surrogateescape")
    # Operating systems cannot pass arguments with zero bytes.
    return tuple(argument.replace("\0", "0") for argument in damaged)


def mutated_names(data: bytes, chance: random.Random) -> bytes:
    """Return a JSON list of file names: one to four are damaged, and two may be equal."""
    names = json.loads(data)
    for _ in range(chance.choice((1, 1, 2, 4))):
        at = chance.randrange(len(names))
        raw = _NUMBER.sub(
            lambda _: str(chance.choice(COUNTS)).encode(),
            names[at].encode(),
            count=chance.randrange(5),
        )
        if chance.random() < 0.4:
            raw = mutated(raw, chance)
        # A byte may expand to three, and a name has at most 255.
        text = raw[:80].decode("utf-8", "replace").replace("/", "_").replace("\0", "0")
        names.append(text if text.strip(". ") else "0x0.png")
    return json.dumps(names).encode()


def mutated_header(data: bytes, chance: random.Random) -> bytes:
    """Return an OpenEXR file with damaged attributes: values, sizes, types, order, repetition."""
    attributes, at = [], 8
    while data[at : at + 1] not in (b"\0", b""):
        name, kind, rest = data[at:].split(b"\0", 2)
        size = struct.unpack("<i", rest[:4])[0]
        attributes.append([name, kind, rest[4 : 4 + size], size])
        at += len(name) + len(kind) + 2 + 4 + size
    for _ in range(chance.choice((1, 1, 2, 3))):
        attribute = attributes[chance.randrange(len(attributes))]
        action = chance.randrange(6)
        if action < 3:
            attribute[2] = chance.choice((_whole_number, _flip, _splice, mutated))(
                attribute[2], chance
            )[: 1 << 16]
            attribute[3] = (
                len(attribute[2]) if chance.random() < 0.9 else chance.choice(WHOLE) & 0x7FFFFFFF
            )
        elif action == 3:
            attribute[1] = attributes[chance.randrange(len(attributes))][1]
        elif action == 4:
            attributes.insert(chance.randrange(len(attributes) + 1), list(attribute))
        elif len(attributes) > 1:
            attributes.remove(attribute)
    header = b"".join(
        b"%b\0%b\0%b%b" % (n, k, struct.pack("<i", size), v) for n, k, v, size in attributes
    )
    return data[:8] + header + data[at:]


def _flip(data: bytes, chance: random.Random) -> bytes:
    at = chance.randrange(len(data) + 1)
    return (
        data[:at]
        + bytes(byte ^ 1 << chance.randrange(8) for byte in data[at : at + 1])
        + data[at + 1 :]
    )


def _splice(data: bytes, chance: random.Random) -> bytes:
    """Replace a piece by nothing, by a random byte, by many copies, or by another piece."""
    start, length = chance.randrange(len(data) + 1), chance.choice((0, 1, 2, 4, 16, 256, len(data)))
    piece, other = data[start : start + length], chance.randrange(len(data) + 1)
    new = chance.choice(
        (b"", chance.randbytes(1), piece * chance.choice((2, 3, 10, 1000)), data[other:][:length])
    )
    return data[:start] + new + data[start + length :]


def _whole_number(data: bytes, chance: random.Random) -> bytes:
    size, code = chance.choice(((1, "B"), (2, "H"), (4, "I"), (8, "Q")))
    if len(data) < size:
        return data
    at = chance.randrange(len(data) - size + 1)
    value = chance.choice(WHOLE) & (1 << 8 * size) - 1
    return data[:at] + struct.pack(chance.choice("<>") + code, value) + data[at + size :]


def _number(data: bytes, chance: random.Random) -> bytes:
    return _in_place(_NUMBER, chance.choice(NUMBERS).encode(), data, chance)


def _word(data: bytes, chance: random.Random) -> bytes:
    return _in_place(_WORD, chance.choice(WORDS).encode(), data, chance)


def _in_place(
    pattern: re.Pattern[bytes], piece: bytes, data: bytes, chance: random.Random
) -> bytes:
    matches = list(pattern.finditer(data[: 1 << 16]))
    if not matches:
        return data
    match = chance.choice(matches)
    return data[: match.start()] + piece + data[match.end() :]


def _line(data: bytes, chance: random.Random) -> bytes:
    lines = data.split(b"\n")
    at, other = chance.randrange(len(lines)), chance.randrange(len(lines))
    action = chance.randrange(3)
    if action == 0:
        del lines[at]
    elif action == 1:
        lines.insert(at, lines[other])
    else:
        lines[at], lines[other] = lines[other], lines[at]
    return b"\n".join(lines)


def _nest(data: bytes, chance: random.Random) -> bytes:
    depth = chance.choice((10, 600, 20_000))
    at = chance.randrange(len(data) + 1)
    return data[:at] + b"[" * depth + (b"]" * depth if chance.random() < 0.5 else b"") + data[at:]


MUTATIONS: tuple[Mutation, ...] = (
    *(_flip, _splice, _splice, _splice, _splice, _splice, _whole_number, _whole_number),
    *(_number, _number, _number, _word, _word, _line, _nest),
)
"""All kinds of damage; the most productive kinds appear more than once."""
