"""The study of viewers as a document: text from a template, every number from the rows."""

from __future__ import annotations

import math
import re

from xfrustum.compare.eye.limits import ACUITY_ARCMIN, EYES_APART_MM, STEREO_ACUITY_ARCSEC
from xfrustum.reports.common.formatting import digits, percent
from xfrustum.reports.common.templates_environment import Filters, plain_text
from xfrustum.reports.measurements.best import pixels
from xfrustum.reports.noticeable_study import facts
from xfrustum.reports.noticeable_study.facts import Rows
from xfrustum.reports.noticeable_study.figures import CURVES, MAP
from xfrustum.reports.noticeable_study.grid import PIXELS
from xfrustum.reports.splitting_study.advice import buffer_name
from xfrustum.reports.studies.origin import Origin
from xfrustum.tolerances import MAX_DEPTH_WRONG, TOLERANCE_PX

USUAL_DISTANCE = 600.0
"""Distance that the first paragraph speaks of, mm: of a reader from a page, and of a hand from the eye."""


def sentence(rows: Rows) -> str:
    """Say the result in one sentence."""
    usual = facts.usual_distance(rows, USUAL_DISTANCE)
    near = facts.rule_near(usual)
    return (
        f"From {usual:g} mm nobody notices a near offset of up to {digits(near)} mm at the plate: "
        f"n = L^2 / ({facts.rule_metres():.3g} m) at the distance L, whatever resolution and depth are."
    )


def document(rows: Rows, origin: Origin, *, pictured: bool = False) -> str:
    """Return the document as Markdown.

    Parameters
    ----------
    pictured
        Whether pictures of both plans for the car lie beside the figures.
    """
    filters: Filters = {
        "percent": percent,
        "pixels": pixels,
        "digits": digits,
        "plain": "{:g}".format,
        "millimeters": _length,
        "buffer": buffer_name,
    }
    own = list(rows)
    values = {
        "rule_near": facts.rule_near,
        "rule": facts.kept_rule(own),
        "scene_rules": facts.rule_of_scenes(own),
        "pixels_needed": PIXELS,
        "crack_free_mm": 1000 * facts.rule_metres() * math.radians(ACUITY_ARCMIN / 60),
        "thresholds": facts.thresholds(own),
        "crack_alone": facts.crack_alone(own),
        "ratios": facts.replay_ratios(own),
        "hopeful": facts.hopeful(own),
        "pictured": pictured,
        "replays": facts.replays(own),
        "windows": facts.windows(own),
        "apart": facts.disagreement(own),
        "quarters": facts.quarters(own),
        "shear": facts.shear_factor(own),
        "depths": facts.depth_limits(own),
        "cells": len(own),
        "scenes": list(dict.fromkeys(row.scene for row in own)),
        "nears": sorted({row.near for row in own}),
        "buffers": list(dict.fromkeys(row.buffer for row in own)),
        "pitches": sorted({row.pitch for row in own}),
        "distances": sorted({row.distance for row in own}),
        "acuity": ACUITY_ARCMIN,
        "stereo_acuity": STEREO_ACUITY_ARCSEC,
        "eyes_apart": EYES_APART_MM,
        "tolerance_px": TOLERANCE_PX,
        "max_depth_wrong": MAX_DEPTH_WRONG,
        "metres": facts.rule_metres(),
        "map": MAP,
        "curves": CURVES,
        "origin": origin,
    }
    text = plain_text("noticeable.md.j2", filters, values)
    return re.sub(r"\n{3,}", "\n\n", text)


def _length(near: float | None) -> str:
    """Write a near in millimeters; `any` where no near of the study is noticed, `-` where every one is."""
    if near is None:
        return "-"
    return "any" if math.isinf(near) else digits(near)
