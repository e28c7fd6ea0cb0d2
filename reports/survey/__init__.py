"""Surveys: hogels judged all over a plate, the bound on the share beyond a tolerance, the worst.

survey  `xfrustum survey`, from the request to the files
rows    Work in blocks, a row for each hogel and setting, and statistics in bounded memory
answer  Record of the answer, its sentence, its JSON object and its page

`compare.sampling` has the bounds.
"""
