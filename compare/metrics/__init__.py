"""Truth against image: what is measured, pixel by pixel and in numbers.

comparison    The judge: truth against raster, pixel by pixel and in numbers (docs/method.md, "What is
              compared")
displacement  Displacement: how far the picture moved, pixel by pixel (docs/method.md, "What is compared")
display       How pictures are shown, here and on every page: clipped to what a screen has, sRGB, 8 bits
error_maps    Each error as an image, pixel by pixel (docs/method.md, "What is compared")
film          Places on the film: of surface points, and of the centers of pixels (CONVENTIONS.md, "Film")
left_out      What a rasterizer leaves out: shadows and interreflection, measured by light paths
noise         Is a picture what a noisy reference converges to? A test per pixel, corrected for their number
paired        Whether one picture of a pair has more wrong pixels than the other, beyond chance
perceptual    How different two pictures look: FLIP and SSIM
pixel_bands   What is judged pixel by pixel, in bands of rows: small enough for a processor's cache
radiance      Radiance error: how far colors are off, in linear RGB, raster minus truth
surface       Which pixels show the wrong surface (docs/method.md, "What is compared")
"""
