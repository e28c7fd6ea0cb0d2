"""Truth against image: what is measured, pixel by pixel and in numbers.

comparison    Truth against raster in numbers, in words, in pictures, and as labelled arrays
error_maps    Errors of each pixel: displacement, surface, triangle and height; pairs of pictures
radiance      How far colors are off, beyond noise, and by what a rasterizer leaves out; FLIP and
SSIM
"""
