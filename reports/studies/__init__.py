"""What the studies share: cells that are measured, kept, written down and read again.

origin  What a study's numbers came from
rows    Rows of a study as Parquet, each with what measured it
"""
