"""Inspection pages: every channel of truth and image at every pixel, and where they differ.

channels   What a pixel's channels are: arrays with names and meanings, of a truth, an image, and its errors
drawn      Channels of hogels that our own rasterizer draws: truth, drawing, errors and their causes
foreign    Channels of hogels of other renderers: what they should show, what they show, and what is wrong
hogels     One hogel on an inspection page: what its channels are, and all their values packed
packing    Channels as deflated bytes, without loss, which a browser turns into typed arrays again
page       The page: one file of bounded size, files beside it for what is larger, and both read back
plate_map  What is known of a plate's hogels, as cells of a map
"""
