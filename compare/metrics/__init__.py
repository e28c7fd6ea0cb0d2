"""Truth against image: what is measured, pixel by pixel and in numbers.

comparison    Truth against raster in numbers, in words, in pictures, and as labelled arrays
displacement  How far the picture moved, and places on the film of surface points and of pixels' centers
error_maps    Errors of each pixel: displacement, surface, triangle and height
left_out      What a rasterizer leaves out: shadows and interreflection, measured by light paths
noise         A test of whether a picture is what a noisy reference converges to, per pixel, corrected
              for their number
paired        Whether one picture of a pair has more wrong pixels than the other, beyond chance
radiance      How far colors are off, in linear RGB, raster minus truth; FLIP and SSIM
surface       The pixels that show the wrong surface
"""
