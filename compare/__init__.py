"""The judge: displacement, surface, triangle and height, each in numbers and as an image.

attribution/     The error budget: wrong pixels charged to links of the chain beyond           When
a hogel is beyond a tolerance: the one definition diagnosis/       What a foreign renderer does
otherwise than asked, and whether that explains its errors eye/              What a viewer sees: the
display's loss, the renderer's, and the scene that a near offset
                  replays
extent           Where the objects of a scene lie, and which apertures see them; the same in words
judging/         One hogel of a foreign renderer judged metrics/         Truth against image: what
is measured, pixel by pixel and in numbers planning/        The planner: settings to draw with, the
fewest slabs, then the largest margin prediction/      Closed forms of every error, from the truth's
geometry alone renderer_model/  A model of somebody else's renderer: conventions, geometry, what it
draws rounding/        The bounds of a rasterizer's rounding, and the classifier of causes (edge,
order, lost) run              Many hogels drawn and judged: the one loop behind reports, surveys,
plans and plates sampling        Samples of a plate's hogels, and what they bound: the share of all
hogels with a property scout           Which apertures of a plate decide the error: a look through
many, before any is measured selfcheck/       The truth against brute force in integers
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
