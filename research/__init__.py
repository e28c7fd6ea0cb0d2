"""What was measured with the package and published: two studies and benchmarks, which nothing else imports.

`xfrustum study` and `xfrustum bench` run them. The studies' data are docs/when-to-split.parquet and
docs/noticeable.parquet; docs/benchmarks.md has the benchmarks' results.

benchmarks    Truth, judged hogels and plates beside loops that anybody would write, as ratios
within one run depth_family  Scenes whose depth alone changes: the same picture on the film, from
shallow to deep noticeable    What do viewers notice of near and depth buffer? Closed forms, and
replays to two eyes splitting     When must the frusta be split? Measures pictures and pairs of
sheets, and says what is enough sweep         Blocks of cells that are measured once and kept, and
rows as Parquet table1        Table 1 of the paper on the project's own car
"""
