"""Ray tracers as second opinions.

tracer          The interface of ray tracers, and the scale in which they are given a scene embree
Embree as tracer: the first triangle of each ray, in single precision and robust mode mitsuba_tracer
Mitsuba as tracer: a second, independent proposal proposals       The image that a tracer alone
would have shown: the second opinion on every pixel sensor          The crossed frustum as a Mitsuba
sensor, for any Mitsuba scene and any integrator
"""
