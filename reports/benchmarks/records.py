"""What the records of several benchmarks have in common."""

from __future__ import annotations

from dataclasses import dataclass

from xfrustum.scenes.model.scene import Scene


@dataclass(frozen=True, kw_only=True)
class BenchmarkedScene:
    """The scene that a benchmark measured."""

    name: str
    hash: str
    triangles: int

    @classmethod
    def of(cls, scene: Scene) -> BenchmarkedScene:
        """Return what is written of a scene."""
        return cls(name=scene.name, hash=scene.content_hash, triangles=len(scene.faces))
