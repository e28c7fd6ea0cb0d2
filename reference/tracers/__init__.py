"""Ray tracers as second opinions, and as judges of what is hidden.

bare_mitsuba    Mitsuba's bare intersection of rays that lie on the device: what a certified truth is
                raced against
embree          Embree as tracer: which triangle does a ray meet first? Single precision, robust mode
entry           Where to start a float32 ray: not far away, for every digit of its origin is spent on
                distance
mitsuba_tracer  Mitsuba as tracer: a second, independent proposal, on all processors or a GPU
proposals       What the tracer alone would have shown: the second opinion on every pixel
sensor          The crossed frustum as a Mitsuba sensor: for any Mitsuba scene, and any integrator
tracer          What a ray tracer has to answer here, and what scale it may answer in
visibility      Does the true frustum see a given surface point, or is something else in front of it?
"""
