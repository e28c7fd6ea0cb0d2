"""Ray tracers as second opinions.

* tracer: the interface of ray tracers, and the scale of their scenes
* embree, mitsuba_tracer: the tracers
* proposals: images of a tracer alone, and second opinions on decisions
* sensor: the crossed frustum as a sensor of Mitsuba
"""
