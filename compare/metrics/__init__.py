"""Truth against image: what is measured, pixel by pixel and in numbers.

comparison        Truth against raster, pixel by pixel and in numbers (docs/method.md, "What is compared")
comparison_facts  What a comparison says of itself: in words, in a table, in pictures, and as labelled
                  arrays
culled            Pixels whose true surface is turned away from the viewer: what culling loses of open
                  meshes
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
pixel_findings    Findings of each pixel by formulas alone: all that is asked of an image before what hides
                  its points
radiance          Radiance error: how far colors are off, in linear RGB, raster minus truth
surface           Surface: the pixels that show the wrong one (docs/method.md, "What is compared")
"""
