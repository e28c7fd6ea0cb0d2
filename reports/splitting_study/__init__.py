"""The study of when the frusta must be split.

advice        The study's table: a resolution, a depth of scene and a depth buffer in, a near or
              cuts out
document      The study as a document: text from a template, every number from the rows
facts         The numbers that the study's document states, each counted in the rows or computed in
              closed form
families      What the study's rows say of the other families: what they share with the first, and what
              helps them
figures       The study's maps, as SVG that needs nothing else: near across, depth buffers down
grid          What the study of splitting measures: which cells, in which order
measure       How the study of splitting measures a cell: truth against raster, and pairs of sheets
              at the far end
rows          The study's measurements as rows, and as Parquet
run           Measure the study's cells, those that are not yet on disk, in blocks that any process may do
study         `xfrustum study splitting`: measured, written down, and resumed where it was stopped
study_record  The study as one JSON object: criteria, what is enough in every case, and what
              measured it
suitability   What the study's rows say: where one pair of frusta is enough, and what helps where it
              is not
"""
