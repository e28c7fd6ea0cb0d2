"""Studies and benchmarks whose results are published in docs; no other room imports them.

`xfrustum study` and `xfrustum bench` run them. The data of the studies are
docs/when-to-split.parquet, docs/noticeable.parquet and docs/ways.parquet; docs/benchmarks.md has
the benchmarks.

* benchmarks: truth, judged hogels and plates against plain loops, as ratios within one run
* depth_family: scenes with equal pictures that differ only in depth
* noticeable: near offsets and depth buffers that viewers notice, in closed form and by replays
* splitting: settings for which one pair of frusta is enough, and settings that need cuts
* sweep: measurement of cells in stored blocks, and rows as Parquet
* paper: table 1 and figure 7 of the paper, on scenes of this project
* ray_rates: rates of exact rays, against trimesh and Embree
* rays: museum of wrong hits
* replays: replays of drawn plates to two eyes
* ways: plates by two cameras, by slabs and by directions
"""
