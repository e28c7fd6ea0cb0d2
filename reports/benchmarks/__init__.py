"""Benchmarks, as ratios within one run; each returns the JSON object that its command prints.

common   What the benchmarks share: the contestants' scene in the record, and columns of text
judge    How fast are hogels judged? Hogels per second, and CPU seconds by stage
plate    How fast are many hogels at once, next to loops that anybody would write?
table1   Table 1 of the paper, measured here: images a second of two databases
truth    How fast is the truth, next to tracers that prove nothing? Million pixels per second
"""
