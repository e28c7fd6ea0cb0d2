"""The verification of foreign renderers: sources, verdict, baselines.

baseline      `verify --baseline`: a verification is held to the measures that were accepted before
sources       Where a foreign renderer's hogel images come from: files, a layout, a program, or a
function verdict       The answer to `xfrustum verify`: limits, figures of hogels, words, and the
files it leaves verification  `xfrustum verify`: is a renderer that nobody here wrote right, and
what is wrong with it? worst         The worst hogels in pictures: truth, image, and where they
differ where         Where the wrong pixels are: by side of the plate, object, hogel, and distance
from outlines
"""
