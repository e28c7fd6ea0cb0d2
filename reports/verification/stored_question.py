"""The question of a verification on disk: what all its hogels are judged by, found out once by one process.

A renderer with noise answers otherwise each time, so that processes that diagnosed it for themselves would
judge by different models. Only a way to restore lost numbers cannot be stored, for it holds images and
truths: then every process diagnoses for itself, and refuses where it finds something else.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from pydantic import TypeAdapter, ValidationError

from xfrustum.compare.diagnosis.diagnosis import Diagnosis
from xfrustum.compare.diagnosis.encodings import FoundEncoding
from xfrustum.compare.diagnosis.faults import Fault
from xfrustum.compare.diagnosis.findings import Findings
from xfrustum.compare.judging.judged import Judging
from xfrustum.compare.renderer_model.drawn_model import DrawnModel
from xfrustum.reports.parts import DESCRIPTION_CLAIM, Parts
from xfrustum.reports.verification.verification import Question
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.files.foreign_images import Reading

QUESTION = "_question.json"
"""File beside the parts; readers of Parquet leave out names that begin like this."""

QUESTION_CLAIM = DESCRIPTION_CLAIM + 1
"""Claim of whoever diagnoses the renderer."""

POLL_S = 0.2
"""Seconds between two attempts to claim the diagnosis, which takes seconds or minutes."""


@dataclass(frozen=True, kw_only=True)
class _Written:
    """The parts of a `Question` that are numbers and words."""

    asked: DrawnModel
    faults: tuple[Fault, ...]
    reading: Reading | None
    diagnosis: Diagnosis
    judging: Judging
    read_as_found: bool


_WRITTEN = TypeAdapter(_Written)


@dataclass(frozen=True, kw_only=True)
class StoredQuestion:
    """A question as the folder of a verification holds it.

    Attributes
    ----------
    digest
        Digest of everything that is written of the question; the hogels that it was asked of have it too.
    missing
        Column and row of each hogel that was to be diagnosed and could not be had.
    restores
        Whether it restores lost numbers, so that every process must diagnose for itself.
    written
        The parts that are numbers and words.
    """

    digest: str
    missing: tuple[tuple[int, int], ...]
    restores: bool
    written: _Written

    @property
    def question(self) -> Question | None:
        """The question; None where it cannot be stored."""
        if self.restores:
            return None
        known = self.written
        encoding = FoundEncoding(faults=known.faults, reading=known.reading)
        found = Findings(encoding=encoding, diagnosis=known.diagnosis, judging=known.judging)
        return Question(asked=known.asked, found=found, read_as_found=known.read_as_found)


_STORED = TypeAdapter(StoredQuestion)


def stored_question(parts: Parts) -> StoredQuestion | None:
    """Return the question in the folder of the parts; None where there is none that is whole."""
    content = parts.read_beside(QUESTION)
    try:
        return None if content is None else _STORED.validate_json(content)
    except ValidationError:
        return None


def agreed_question(
    parts: Parts, diagnosed: Callable[[], tuple[Question, tuple[tuple[int, int], ...]]]
) -> tuple[StoredQuestion, Question]:
    """Return the question in the folder, which the first process that asks for it finds out and stores.

    Parameters
    ----------
    parts
        Folder of the parts.
    diagnosed
        Function that diagnoses the renderer; it returns the question and `StoredQuestion.missing`.

    Raises
    ------
    InputError
        The question cannot be stored, and this process finds another one; or the disk is full.
    """
    with parts.claims() as claims:
        while not claims.take(QUESTION_CLAIM):
            time.sleep(POLL_S)
        stored = stored_question(parts)
        if stored is None:
            question, missing = diagnosed()
            content = written(question, missing)
            parts.write_beside(QUESTION, content)
            stored = _STORED.validate_json(content)
            return stored, stored.question or question
    known = stored.question
    if known is None:
        known, missing = diagnosed()
        if _STORED.validate_json(written(known, missing)).digest != stored.digest:
            raise InputError(
                f"{parts.folder}: another process has diagnosed the renderer otherwise, for its images are "
                "not the same each time; judge them by one process, without --workers, --scheduler or --part"
            )
    return stored, known


def written(question: Question, missing: tuple[tuple[int, int], ...]) -> bytes:
    """Return a question as the JSON object that is stored; numbers keep all digits."""
    found = question.found
    parts = _Written(
        asked=question.asked,
        faults=found.encoding.faults,
        reading=found.encoding.reading,
        diagnosis=found.diagnosis,
        judging=found.judging,
        read_as_found=question.read_as_found,
    )
    fields = {"written": asdict(parts), "restores": found.encoding.restoring is not None}
    digest = hashlib.sha256(plain_json(fields).encode()).hexdigest()
    return plain_json({**fields, "digest": digest, "missing": missing}).encode()


def plain_json(fields: Any) -> str:
    """Return fields as JSON, with numbers of numpy as Python's own."""
    return json.dumps(fields, default=_plain)


def _plain(value: Any) -> object:
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{type(value).__name__} cannot be written")
