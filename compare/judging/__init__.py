"""Hogels judged: many of the project's own rasterizer, and one of a foreign renderer.

charging         The predictor and the chains by which wrong pixels of one hogel's drawings are charged
                 to causes
engine           The one engine that draws and judges many hogels: drawing, tracing and judging overlap
foreign_cameras  The cameras of a foreign renderer, with bounds of rounding for a precision that nobody
                 has stated
frames           Frames that are drawn to be judged, in turns of the thread that draws
groups           Frames that are alone with their cameras, compared in groups
image_displacement  How far what an image shows has moved: by its surface points, or by its outlines
in_order         Tasks that run side by side, a bounded number at a time, and whose results come in
                 order
judge            Many hogels drawn with several settings each, and judged by their certified truth
judged           One hogel of a foreign renderer, judged by a question: the truth, or what its author
                 declares
outline_shift    Displacement of a picture's outlines by registration, where no pixel names a triangle
parts            Settings in parts that are drawn together: those of the same cameras follow one another
stopwatch        The one place that takes time: wall seconds per named stage, of one task or of several
                 side by side
threads          The two threads beside those that judge: one that draws all hogels, and one that traces
                 them in order
"""
