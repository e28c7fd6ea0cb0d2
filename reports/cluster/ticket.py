"""A scene as it travels to workers: by path and content hash."""

from __future__ import annotations

from dataclasses import dataclass, replace
from importlib import metadata

from xfrustum.scenes.appearance.sampling import Sampling, Transport
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.look import look_hash
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.opening.catalogue import open_scene
from xfrustum.scenes.plate.frustum import Frustum
from xfrustum.scenes.plate.plate import Plate

SHOWN_DIGITS = 12
"""Digits of a hash that a message shows."""


@dataclass(frozen=True, kw_only=True)
class SceneTicket:
    """The name of a scene, and everything that must agree where it is opened again.

    Attributes
    ----------
    source
        Absolute path of a scene file, or name of a built-in scene; empty for a scene that was made in memory,
        which no other process can open.
    content, look
        Hashes of geometry and of what colors depend on.
    plate, frustum, sampling, transport
        Parts of the scene that options may have changed.
    version
        Version of the program, which decides the numbers too.
    """

    source: str
    content: str
    look: str
    plate: Plate
    frustum: Frustum
    sampling: Sampling
    transport: Transport
    version: str

    @classmethod
    def of(cls, scene: Scene) -> SceneTicket:
        """Return the ticket of a scene."""
        return cls(
            source=scene.source,
            content=scene.content_hash,
            look=look_hash(scene),
            plate=scene.plate,
            frustum=scene.frustum,
            sampling=scene.sampling,
            transport=scene.transport,
            version=metadata.version("xfrustum"),
        )

    @property
    def description(self) -> dict[str, object]:
        """Everything but where the scene is: what must be the same to go on with a result."""
        return {key: value for key, value in vars(self).items() if key != "source"}

    def open(self) -> Scene:
        """Open the scene again, and see that it is the same.

        Raises
        ------
        InputError
            There is no such scene here, or it is another one, or the program is of another version.
        """
        version = metadata.version("xfrustum")
        if version != self.version:
            raise InputError(
                f"a worker has xfrustum {version}, the command {self.version}: install one version everywhere"
            )
        scene = replace(
            open_scene(self.source),
            plate=self.plate,
            frustum=self.frustum,
            sampling=self.sampling,
            transport=self.transport,
        )
        found = {"content": scene.content_hash, "look": look_hash(scene)}
        for name, mine in found.items():
            wanted = getattr(self, name)
            if mine != wanted:
                raise InputError(
                    f"{self.source}: a worker finds another {name} than the command (hash "
                    f"{mine[:SHOWN_DIGITS]}, not {wanted[:SHOWN_DIGITS]}); give both the same file, and "
                    "start the workers again where it has changed since"
                )
        return scene
