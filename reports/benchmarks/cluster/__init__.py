"""How surveys scale: workers of this machine, a scheduler with many simulated workers, and sizes on paper.

cluster     `xfrustum bench cluster`: efficiency of two workers, and the scheduler's share of the time
forecast    Time and memory of plates too large to be measured here, on paper, and what breaks first
simulation  A real scheduler with real messages, and workers that sleep as long as a block takes
sleepers    Simulated workers of a Dask cluster, many in one process: a program of its own
"""
