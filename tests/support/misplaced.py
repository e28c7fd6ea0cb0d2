"""Pixels whose centers the triangles drawn there do not reach.

Surface points of the raster are computed on the drawn triangle, for the pixel's center
(docs/adr/0005): this is the other half of the measurement, that the triangle was drawn where its
camera puts it.
"""

from xfrustum.compare.attribution.budget import drawing_cameras
from xfrustum.compare.rounding.causes import misplaced_pixels
from xfrustum.scenes.arrays import Mask
from xfrustum.scenes.model.device_model import DeviceModel
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.model.scene import Scene


def misplaced(scene: Scene, raster: HogelImage, device: DeviceModel) -> Mask:
    """Return pixels (H, W) whose centers lie outside their triangles by more than rounding."""
    return misplaced_pixels(scene.triangles, drawing_cameras(scene, raster, device), raster)
