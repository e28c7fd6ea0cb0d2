"""Work whose blocks of hogels become Parquet parts: everything but what a session does with a block."""

from __future__ import annotations

from dataclasses import dataclass

from xfrustum.reports.cluster.blocks import Blocks
from xfrustum.reports.cluster.claims import Claims
from xfrustum.reports.cluster.job import HogelJob
from xfrustum.reports.cluster.ticket import SceneTicket
from xfrustum.reports.parts import Parts
from xfrustum.scenes.model.scene import Scene


@dataclass(frozen=True, kw_only=True)
class RowsJob(HogelJob):
    """Hogels of a scene that are judged in blocks, each of which becomes a part of rows.

    Attributes
    ----------
    ticket
        The scene.
    blocks
        Blocks of the hogels that are judged.
    parts
        Folder of the rows.
    """

    ticket: SceneTicket
    blocks: Blocks
    parts: Parts

    def finished(self, number: int) -> bool:
        """Return whether a block has its part."""
        return self.parts.finished(number)

    def claims(self) -> Claims:
        """Return the claims of the folder of parts."""
        return self.parts.claims()

    def scene_here(self, scene: Scene | None) -> Scene:
        """Return the scene that a process has, or open it by its ticket.

        Raises
        ------
        InputError
            See `SceneTicket.open`.
        """
        return self.ticket.open() if scene is None else scene
