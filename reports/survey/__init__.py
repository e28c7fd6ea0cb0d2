"""Surveys: hogels judged all over a plate, what that says of all, and where it is worst.

answer  The answer of a survey: counts and bounds for each setting, the sentence, the JSON object,
the page rows    What a survey judges, block by block; a row for each hogel and setting, in bounded
memory survey  `xfrustum survey`: which share of a plate's hogels is beyond a tolerance, and where
it is worst

The bounds are those of `compare.sampling`.
"""
