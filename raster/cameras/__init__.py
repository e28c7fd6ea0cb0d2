"""The two cameras as matrices, their passes, and their depth formats.

* cameras: depth formats and matrices of C and C*, and the passes that draw them in order
* description: the cameras for other renderers, as JSON, glTF and Mitsuba sensors
"""
