"""Studies and benchmarks with the package, published in docs; no other room imports them.

`xfrustum study` and `xfrustum bench` run them. The data of the studies are
docs/when-to-split.parquet and docs/noticeable.parquet; docs/benchmarks.md has the benchmarks.

* benchmarks: truth, judged hogels and plates against plain loops, as ratios within one run
* depth_family: scenes that differ in depth alone, with the same picture on the film
* noticeable: near offsets and depth buffers that viewers notice, in closed form and by replays
* splitting: pictures and pairs of sheets that need split frusta or a single pair
* sweep: blocks of cells that are measured once and kept, and rows as Parquet
* table1: table 1 of the paper on the project's own car
"""
