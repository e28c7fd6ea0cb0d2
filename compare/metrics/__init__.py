"""Truth against image: what is measured, pixel by pixel and in numbers.

comparison    Truth against raster in numbers, in words, in pictures, and as labelled arrays
error_maps    Errors of each pixel: displacement, surface, triangle and height
left_out      What a rasterizer leaves out: shadows and interreflection, measured by light paths
noise         Tests against chance: a picture against a noisy reference, wrong pixels of two pictures
radiance      How far colors are off, in linear RGB, raster minus truth; FLIP and SSIM
"""
