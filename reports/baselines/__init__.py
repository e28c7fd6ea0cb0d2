"""Baselines: accepted measures of a renderer, what got worse since, and the history of both.

baseline    `verify --baseline`: one verification held to the accepted measures, and kept
changes     What changed from accepted runs to the present one, beyond noise
editions    Accepted states of a renderer, in their order, also where branches were merged
figures     Curves of the history page
measures    The numbers of a hogel, and of a plate, that are kept and compared
page        The history page: every measure over all runs, as one file that works offline
records     Runs and their rows, as Parquet files hold them
repository  The commit of the repository that a renderer is in
store       The folder of a baseline: a file for each run, which nobody writes again
summary     What changed in words: for the terminal, for JSON, and as Markdown
tolerance   By how much a measure may differ: learnt from repeated runs, or stated
"""
