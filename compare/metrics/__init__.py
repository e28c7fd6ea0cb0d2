"""Truth against image: what is measured, pixel by pixel and in numbers.

comparison        Truth against raster, pixel by pixel and in numbers (docs/method.md, "What is compared")
comparison_facts  What a comparison says of itself: in words, in a table, in pictures, and as labelled
                  arrays
displacement      Displacement: how far the picture moved, pixel by pixel (docs/method.md, "What is
                  compared")
error_maps        Each error as an image, pixel by pixel (docs/method.md, "What is compared")
film              Places on the film: of surface points, and of the centers of pixels (CONVENTIONS.md,
                  "Film")
left_out          What a rasterizer leaves out: shadows and interreflection, measured by light paths
noise             A test of whether a picture is what a noisy reference converges to, per pixel, corrected
                  for their number
paired            Whether one picture of a pair has more wrong pixels than the other, beyond chance
perceptual        How different two pictures look: FLIP and SSIM
radiance          Radiance error: how far colors are off, in linear RGB, raster minus truth
surface           Surface: the pixels that show the wrong one (docs/method.md, "What is compared")
"""
