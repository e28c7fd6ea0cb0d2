"""Surveys: hogels judged all over a plate, what that says of all, and where it is worst.

answer    The answer of a survey: counts and bounds for each setting, the sentence, and the JSON object
figures   Figures of a survey: maps over the plate, distributions, and error by depth of content
foreign   Surveys of the plates of other renderers: each hogel judged as `verify` does
hogels    Surveys of our own rasterizer: each hogel drawn with every setting and judged by its truth
page      What a survey leaves behind: the page and survey.json, beside the rows
rows      Rows of a survey, one for each hogel and setting, and bins of depth
survey    `xfrustum survey`: which share of a plate's hogels is beyond a tolerance, and where it is worst
tally     All rows of a survey in bounded memory: counts, maps, distributions and the worst hogels
"""
