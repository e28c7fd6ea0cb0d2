"""Truth against image, pixel by pixel and in numbers.

comparison  Truth against raster: numbers, error maps, and labelled arrays
error_maps  Errors of each pixel: displacement, surface, triangle and height; pairs of pictures
radiance    Radiance error beyond noise, light that a rasterizer leaves out; FLIP and SSIM
"""
