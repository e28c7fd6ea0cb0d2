"""Errors of images against the truth: measured, predicted, explained, and judged.

attribution/     Error budget: wrong pixels charged to links of the chain
beyond           Definition of a hogel beyond a tolerance
device/          Rounding of an OpenGL device, from fingerprints and recorded frames
diagnosis/       Defects of a foreign renderer that explain its errors
eye/             Views of eyes: loss of the display and of the renderer
judging/         Hogels of a foreign renderer judged
metrics/         Truth against image, pixel by pixel and in numbers
planning/        Settings to draw with: the fewest slabs, then the largest margin
prediction/      Closed forms of every error, from the geometry of the truth alone
renderer_model/  Model of a foreign renderer: conventions, geometry, pictures
rounding/        Bounds of a rasterizer's rounding, and the classifier of causes
run              Evaluator of many hogels, behind reports, surveys, plans and plates
sampling         Samples of the hogels of a plate, and bounds for all hogels
scout            Apertures of a plate that decide the error, from coarse views
selfcheck/       Truth against brute force in integers
"""

import lazy_loader

# Names are imported when first used: closed forms answer without loading the reference.
__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "metrics.comparison": ["Comparison", "compare_images"],
        "metrics.error_maps": ["ErrorMaps", "HeightError", "Spread"],
    },
)
