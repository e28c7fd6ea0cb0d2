"""The description of a plate: everything that decides its pixels, and must agree to go on with a store."""

from __future__ import annotations

from importlib import metadata
from typing import Any

from xfrustum.reports.common.json_ready import json_ready
from xfrustum.reports.plate.sources import HogelSource
from xfrustum.scenes.model.plate_content import PlateContent
from xfrustum.scenes.model.scene import look_hash

SOURCE = "source"
"""Key that says where the scene came from, in the description of the scene: for people, it need not agree."""


def described(source: HogelSource) -> dict[str, Any]:
    """Return everything that decides the pixels that a source draws, as JSON; what is None is left out.

    Plates of truths have no `settings`, those with one sample a pixel through the middle of its aperture no
    `sampling`, and those without light paths no `transport`.
    """
    scene, content = source.scene, source.content
    usual = PlateContent(color=content.color, ids=content.ids).channels == content.channels
    sampling, transport = scene.sampling, scene.transport
    finer = {"supersample": sampling.supersample, "multisample": sampling.multisample}
    sampled = sampling.aperture > 1 or max(finer.values()) > 1
    described: dict[str, Any] = {
        "scene": {
            "name": scene.name,
            SOURCE: scene.source,
            "units": scene.units,
            "hash": scene.content_hash,
            "look": look_hash(scene),
        },
        "plate": scene.plate,
        "frustum": scene.frustum,
        "settings": source.settings,
        "effects": sorted(source.simulated),
        "content": {
            "color": content.color,
            "ids": content.ids,
            **({} if usual else {"channels": content.channels}),
            **({"judged": True} if source.judged else {}),
        },
        "renderer": {"device": source.renderer, "xfrustum": metadata.version("xfrustum")},
        "sampling": {"aperture": sampling.aperture, **{k: n for k, n in finer.items() if n > 1}}
        if sampled
        else None,
        "transport": {
            "shadows": transport.shadows,
            "interreflection": transport.interreflection,
            "samples": transport.samples,
        }
        if source.transported
        else None,
    }
    return {key: value for key, value in json_ready(described).items() if value is not None}
