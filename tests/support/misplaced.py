"""Pixels whose centers lie outside the triangles drawn there.

Surface points of the raster are computed on the drawn triangle, for the pixel's center
(docs/adr/0005). This module completes the measurement: it tests whether the camera images the
triangle at the pixel.
"""

from xfrustum.compare.attribution import drawing_cameras
from xfrustum.compare.rounding.causes import misplaced_pixels
from xfrustum.scenes.arrays import Mask
from xfrustum.scenes.model.device_model import DeviceModel
from xfrustum.scenes.model.images import HogelImage
from xfrustum.scenes.model.scene import Scene


def misplaced(scene: Scene, raster: HogelImage, device: DeviceModel) -> Mask:
    """Return pixels (H, W) whose centers lie outside their triangles by more than rounding."""
    return misplaced_pixels(scene.triangles, drawing_cameras(scene, raster, device), raster)
