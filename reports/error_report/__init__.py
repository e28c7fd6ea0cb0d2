"""The error report: every setting of a scene drawn and judged; page, JSON and Parquet.

best         One row of a report, and which depth buffer and near planes are best, in a sentence
images       Pictures for people: encoded, small, with scales that stay the same over a whole report
light        What a report says about light beside its rows: effects, the eye vector, and what a rasterizer
             misses
page         The page: one HTML file with its pictures, its figures and plotly.js inside
report       `xfrustum report`: rasterizes and judges every setting at every aperture, and writes index.html,
             report.json and measurements.parquet, all or none
settings     What a report sweeps: options, near planes, depth buffers, and camera geometries with names
"""
