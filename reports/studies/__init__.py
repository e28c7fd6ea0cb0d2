"""Two studies of many scenes and settings, as scripts on the package's own functions.

Their published data are docs/when-to-split.parquet and docs/noticeable.parquet.

noticeable       What do viewers notice of near and depth buffer? Closed forms, and replays to two eyes
splitting        When must the frusta be split? Measures pictures and pairs of sheets
splitting_cells  Cells and rows of the study of splitting, whether one pair of frusta is enough in them, and
                 what the rows say
sweep            Blocks of cells that are measured once and kept, and rows as Parquet
"""
