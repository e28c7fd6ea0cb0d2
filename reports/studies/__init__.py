"""Two studies of many scenes and settings, as scripts on the package's own functions.

Their published data are docs/when-to-split.parquet and docs/noticeable.parquet.

noticeable  What do viewers notice of near and depth buffer? Closed forms, and replays to two eyes
splitting   When must the frusta be split? Measures pictures and pairs of sheets, and says what is enough
sweep       Blocks of cells that are measured once and kept, and rows as Parquet
"""
