"""Two studies of many scenes and settings, as scripts on the package, which `xfrustum study NAME` runs.

Their published data are docs/when-to-split.parquet and docs/noticeable.parquet.

depth_family  Scenes whose depth alone changes: the same picture on the film, from shallow to deep
noticeable    What do viewers notice of near and depth buffer? Closed forms, and replays to two eyes
splitting     When must the frusta be split? Measures pictures and pairs of sheets, and says what is enough
sweep         Blocks of cells that are measured once and kept, and rows as Parquet
"""
