"""What the studies share: cells that are measured, kept, written down and read again.

cells   Cells of a study in blocks that any process may measure; what is measured is kept
folder  The folder of a study: probed before the work, and its document written with figures and data
origin  What a study's numbers came from, and what measures here and now
rows    Rows of a study as Parquet, each with what measured it
store   Results on disk as they come: what is written survives whatever ends the process
"""
