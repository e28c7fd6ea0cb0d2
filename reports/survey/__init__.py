"""Surveys: hogels judged all over a plate, what that says of all, and where it is worst.

answer  The answer of a survey: counts and bounds for each setting, the sentence, and the JSON object
jobs    What a survey judges: hogels that our rasterizer draws, or those of another renderer, block by block
page    What a survey leaves behind: the page with its figures, and survey.json, beside the rows
rows    Rows of a survey, one for each hogel and setting, and all rows of a setting in bounded memory
survey  `xfrustum survey`: which share of a plate's hogels is beyond a tolerance, and where it is worst

The bounds are those of `compare.sampling`.
"""
