"""Benchmarks, as ratios within one run.

scaling/  how time and memory grow with triangles, pixels and apertures
plate     How fast are many hogels at once, next to loops that anybody would write? Hogels per second,
          and ratios
table1    Table 1 of the paper, measured here: how many images a second of two databases, both cameras
          together
truth     How fast is the truth, next to tracers that prove nothing? Million pixels per second, and ratios
"""
