"""Benchmarks, as ratios within one run.

cluster/           How surveys scale: workers of this machine, a scheduler with many simulated workers,
                   and sizes on paper
scaling/           How time and memory grow with triangles, pixels and apertures
judge              How fast are hogels judged? Hogels per second, CPU seconds by stage, and ratios
judge_contestants  Contestants for a race to judged hogels: streams, loops, and what they cannot do without
judge_stream       Many hogels judged in a process of its own, as a stream or in a loop: seconds, and the
                   most memory it had
plate              How fast are many hogels at once, next to loops that anybody would write? Hogels per
                   second, and ratios
plate_contestants  Contestants for a race over one row of a plate: many hogels at once, and loops that
                   anybody would write
records            What the records of several benchmarks have in common
table1             Table 1 of the paper, measured here: how many images a second of two databases, both
                   cameras together
truth              How fast is the truth, next to tracers that prove nothing? Million pixels per second,
                   and ratios
truth_contestants  Contestants for a race to the truth: the certified one, and what others would have
                   called one
"""
