"""The two cameras as matrices, their passes, and their depth formats.

cameras      C and C*: their depth formats, their matrices, and the passes that draw them in order
description  The cameras for renderers that somebody else writes: as JSON, for glTF and for Mitsuba
"""
