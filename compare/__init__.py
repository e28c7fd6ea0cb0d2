"""Errors of images against the truth: measured, predicted, explained, and judged.

* attribution: error budget, wrong pixels and radiance errors charged to links of the chain
* comparison: errors of a raster image against the truth, by pixel and in numbers, with radiance
* diagnosis: defects of a foreign renderer that explain its errors
* error_maps: errors of each pixel, and pairs of pictures
* eye_loss: views replayed to an eye, and the losses of the display and of a renderer
* fingerprints, recorded: rounding of an OpenGL device, from test pictures and recorded frames
* judging: verdicts on hogels of a foreign renderer
* noticeable: near offsets and depth buffers that a viewer notices, in closed form
* planning: search for drawing settings with the fewest slabs, then the largest margin
* prediction: closed forms of every error, from the geometry of the truth alone
* rational, selfcheck: independent truth in integers, and the reference compared with it
* renderer_model: model of a foreign renderer, with conventions, geometry and pictures
* rounding: bounds of a rasterizer's rounding, and the classifier of causes
* run: evaluator of many hogels, behind reports, surveys, plans and plates
* sampling: samples of the hogels of a plate, and bounds on the share beyond a tolerance
* scout: apertures of a plate that decide the error, from coarse views
"""

import lazy_loader

# Names are imported when first used: closed forms run without loading the reference.
__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "comparison": ["Comparison", "compare_images"],
        "error_maps": ["ErrorMaps", "HeightError", "Spread"],
    },
)
