"""The error report: every setting of a scene drawn and judged; page, JSON and Parquet.

best         The recommendation: which depth buffer and near planes are best, and the sentence that says so
figures      The figures of a report: errors, causes and camera geometries against near, with closed forms
images       Pictures for people: encoded, small, with scales that stay the same over a whole report
light        What a report says about light beside its rows: effects, the eye vector, and what a rasterizer
             misses
measurement  One row of a report: a raster image judged against the truth, its pictures, and its columns
page         The page: one HTML file with its pictures, its plots and plotly.js inside
report       `xfrustum report`: writes index.html, report.json and measurements.parquet, all or none
settings     What a report sweeps: options, near planes, depth buffers, and camera geometries with names
sweep        The main job: trace the truth once per aperture, rasterize every setting, compare each
"""
