"""Surveys: hogels judged all over a plate, with a bound on the share beyond a tolerance.

survey  `xfrustum survey`, from the request to the files
rows    Work in blocks, a row for each hogel and setting, and statistics in bounded memory
answer  Result: record, sentence, JSON object and page

`compare.sampling` has the bounds.
"""
