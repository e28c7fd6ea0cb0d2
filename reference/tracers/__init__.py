"""Ray tracers as second opinions.

bare_mitsuba    Mitsuba's bare intersection of rays that lie on the device: what a certified truth is
                raced against
embree          Embree as tracer: the first triangle of each ray, in single precision and robust mode
entry           Origins of float32 rays close to the scene, because a distant origin loses digits
mitsuba_tracer  Mitsuba as tracer: a second, independent proposal, on all processors or a GPU
names           Names of the tracers that can be asked for
proposals       The image that the tracer alone would have shown: the second opinion on every pixel
proposals_jit   Rays of pixels made by a Dr.Jit kernel, and traced in it where Mitsuba traces on the
                processors
sensor          The crossed frustum as a Mitsuba sensor, for any Mitsuba scene and any integrator
tracer          The interface of ray tracers, and the scale in which they are given a scene
"""
